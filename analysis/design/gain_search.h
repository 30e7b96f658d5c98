#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "linear/gain_rows.h"
#include "messages/signals.h"

/// A search for the gains of a law that settle fastest and keep a modulus margin at all postures.
/// It uses sequential linear programming in the logarithms theta of the gains. The search shortens
/// a time T whenever the loop settles within T. The variable s bounds the logarithms of all errors
/// from T on, after a displacement of each joint alone. A step minimises s + 60 v within a trust
/// region, with v the largest lack of a margin. The spectral radius is no substitute for s: it has
/// no derivative where two poles are equal, and optima have equal poles.
namespace tachless::design {

using linear::Feedback;
using linear::LinearLaw;
using linear::RestLoop;

struct GainProblem {
  std::vector<linear::RestLoop> loops;
  std::vector<messages::ReferencePoint> rests;  ///< posture of each loop
  std::vector<std::size_t> settling;            ///< indices of the loops whose errors are judged
  /// Computes the law about a posture from theta, with its derivatives if they are asked for.
  std::function<linear::Feedback(const Eigen::VectorXd& theta, const messages::ReferencePoint& rest,
                                 bool derivatives)>
      feedback;
  bool same_everywhere = false;  ///< the law of loop 0 is the law of all loops
  bool resonant = false;         ///< poles may be lightly damped: flexible joints
  Eigen::VectorXd lower, upper;  ///< bounds of theta
  Eigen::VectorXd most_gain;     ///< largest torque of each joint per angle of the same joint
  double margin = 0.5;
  std::vector<double> share;  ///< share of the margin that each loop has to keep
  /// Sufficient settling time. If it is reached, the search increases the margin. 0: as fast as
  /// possible.
  double settling_s = 0;
};

/// A constraint that keeps the gains from being faster.
struct Binding {
  enum class Kind { margin, count, bound } kind = Kind::margin;
  std::size_t which = 0;  ///< number of the loop, joint or variable
  /// Share of the settling time that is saved if the constraint is loosened by a tenth.
  double settling_share = 0;
};

struct FoundGains {
  Eigen::VectorXd theta;
  /// Longest over the judged loops [s]; infinite: the margin is not kept.
  double settling_s = infinity;
  double modulus = 0;  ///< least modulus
};

/// Evaluates the gains: stability of all loops, least modulus and settling time.
FoundGains judged(const GainProblem& problem, const Eigen::VectorXd& theta);

/// Returns the least modulus over the loops; 0 where one is unstable.
double least_modulus(const GainProblem& problem, const Eigen::VectorXd& theta);

/// Returns the least modulus at each loop. A lower bound replaces a modulus that exceeds the margin
/// by more than `above`.
std::vector<double> least_moduli(const GainProblem& problem, const Eigen::VectorXd& theta,
                                 double above);

/// Returns the settling time at each loop [s]. A loop that does not settle gets about 2.6e4 s, the
/// end of the longest interval examined.
std::vector<double> settling_times(const GainProblem& problem, const Eigen::VectorXd& theta);

/// Function that adds loops to the problem at which these gains violate a constraint. It returns
/// whether it added any.
using AddLoops = std::function<bool(GainProblem& problem, const Eigen::VectorXd& theta)>;

/// Searches for faster gains in at most `most_steps` steps from `theta`. Calls `add` every few
/// steps and at the end of the search. If a loop is unstable at `theta`, returns the evaluation of
/// `theta` alone. The result is deterministic.
FoundGains faster_gains(GainProblem& problem, const Eigen::VectorXd& theta, int most_steps,
                        const AddLoops& add,
                        const std::function<void(int step, const FoundGains&)>& tell);

/// Returns the constraints that bind at these gains, the costliest first.
std::vector<Binding> bindings(const GainProblem& problem, const FoundGains& gains);

}  // namespace tachless::design
