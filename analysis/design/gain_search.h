#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "linear/gain_rows.h"
#include "messages/signals.h"

/// The gains of a law that settle first with a modulus margin kept at all postures, by sequential
/// linear programming in the logarithms theta of the gains. For a time T that is shortened each
/// time it is met, the variable s bounds the logarithms of all errors from T on, from
/// each joint alone; a step minimises s + 60 v with v what the margins lack, within a trust region.
/// Not the spectral radius: it has no derivative where poles meet, which is where optima lie.
namespace tachless::design {

using linear::Feedback;
using linear::LinearLaw;
using linear::RestLoop;

struct GainProblem {
  std::vector<linear::RestLoop> loops;
  std::vector<messages::ReferencePoint> rests;  ///< where they are
  std::vector<std::size_t> settling;            ///< those whose errors are looked at
  /// theta → the law about a posture, with its derivatives where they are asked for.
  std::function<linear::Feedback(const Eigen::VectorXd& theta, const messages::ReferencePoint& rest,
                                 bool derivatives)>
      feedback;
  bool same_everywhere = false;  ///< that of loop 0 is that of all
  bool resonant = false;         ///< poles may be little damped: flexible joints
  Eigen::VectorXd lower, upper;  ///< of theta
  Eigen::VectorXd most_gain;     ///< torque per measured angle, each joint's own
  double margin = 0.5;
  std::vector<double> share;  ///< of the margin, that a loop has to keep
  double settling_s = 0;  ///< that is enough: from there on, more margin; 0: as fast as possible
};

/// What keeps the gains from being faster.
struct Binding {
  enum class Kind { margin, count, bound } kind = Kind::margin;
  std::size_t which = 0;      ///< the loop, the joint, the variable
  double settling_share = 0;  ///< of the settling time saved by loosening it by a tenth
};

struct FoundGains {
  Eigen::VectorXd theta;
  double settling_s = infinity;  ///< of what was looked at; infinite: nothing keeps the margin
  double modulus = 0;            ///< the least
};

/// Whether all loops are stable, and the least modulus.
FoundGains judged(const GainProblem& problem, const Eigen::VectorXd& theta);

/// The least modulus at each of the loops; that much above the margin, a bound from below.
std::vector<double> least_moduli(const GainProblem& problem, const Eigen::VectorXd& theta,
                                 double above);

/// The settling time at each of the loops, infinite where it is unstable [s].
std::vector<double> settling_times(const GainProblem& problem, const Eigen::VectorXd& theta);

/// Adds to the problem loops at which these gains lack something; whether there were any.
using AddLoops = std::function<bool(GainProblem& problem, const Eigen::VectorXd& theta)>;

/// From there in so many steps at most; every few steps and at the end loops are added.
/// Deterministic. Where a loop is unstable at the start, nothing but that.
FoundGains faster_gains(GainProblem& problem, const Eigen::VectorXd& theta, int most_steps,
                        const AddLoops& add,
                        const std::function<void(int step, const FoundGains&)>& tell);

/// The constraints that bind at these gains, the one that costs most first.
std::vector<Binding> bindings(const GainProblem& problem, const FoundGains& gains);

}  // namespace tachless::design
