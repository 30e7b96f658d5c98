#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "base/quantities.h"
#include "robot/model.h"

/// Postures over which a condition on M and C is checked, with M and C at each, and extremes over
/// them. For some robots the values between the postures are bounded too. Only then is a result
/// "proved".
namespace tachless::numerics {

/// Result of a local minimisation.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0;
};
/// Minimises f locally without derivatives (NLopt's Subplex) from `start` with first steps `step`.
/// `f` may return +infinity where it has no value. The result is a local minimum, so the caller
/// chooses the starts.
Minimum minimise(const std::function<double(const Eigen::VectorXd&)>& f,
                 const Eigen::VectorXd& start, double step, int max_evaluations);

/// Bounds of each coordinate; they may be infinite.
struct Box {
  Eigen::VectorXd lower, upper;
};
/// Does the same within a box, for an f that is smooth near its minima (NLopt's BOBYQA, which fits
/// quadratic models). The least eigenvalue of a smooth matrix is such an f: where eigenvalues
/// cross, the least one has no minimum. The search ends where f is minus infinity. Precondition:
/// each coordinate may vary.
Minimum minimise_within(const std::function<double(const Eigen::VectorXd&)>& f,
                        const Eigen::VectorXd& start, const Box& box, double step,
                        int max_evaluations);

/// M(q) and C(q, e_j), with C(q, x) = sum_j x_j C[j]; or one harmonic of these functions of q2.
struct Inertia {
  Eigen::MatrixXd M;               ///< [kg m2]
  std::vector<Eigen::MatrixXd> C;  ///< [kg m2]
};

/// Returns M and C of the robot at `q`.
Inertia inertia_at(const robot::Model& model, const Vector& q);

/// Returns the matrices A_j with C(q, S x) = sum_j x_j A_j. The columns of S are directions of v.
std::vector<Eigen::MatrixXd> coriolis_along(const std::vector<Eigen::MatrixXd>& C,
                                            const Eigen::MatrixXd& S);

/// An extreme over the postures.
struct Extreme {
  double value = 0;  ///< the best value found
  Vector q;          ///< posture of that value [rad; m]
};

struct PostureOptions {
  int circle_points = 360;  ///< postures of a two-joint arm
  /// True: the values between the grid points of the circle are bounded. Without the bounds the
  /// result rests on sampling alone.
  bool bound_between = true;
  int samples = 2048;  ///< postures of other robots
  /// For other robots: only postures within `reach` [rad; m] of one of these centres. Empty: all.
  std::vector<Vector> centres = {};
  Vector reach = {};
};

/// A set of postures that represents all postures of a robot. Gravity is not included because the
/// law cancels it. The set depends on the robot:
///
/// - A single joint carries all bodies: one posture, since M does not depend on the joint.
/// - M and C depend on the second of two revolute joints alone: a grid over q2. M and C are then
/// trigonometric polynomials of low degree in q2 alone. Between two grid points they are within
/// step^2/8 sup|d2/dq2^2| of the chord, and their harmonics bound that term.
/// - Otherwise: a low-discrepancy sequence over the full circle of each revolute joint and the
/// range of each prismatic joint, or over the boxes around `centres`. The full circle is needed
/// because errors are not wrapped and the level set does not end at a joint limit.
struct Postures {
  enum class Kind { point, circle, sampled };
  /// The parts of Inertia that a function of it reads. M alone takes a tenth of the time.
  enum class Reads { M, M_and_C };
  /// How `smallest` searches.
  struct Search {
    bool refine = false;  ///< the three smallest values of a sampled set are refined locally
    Reads reads = Reads::M_and_C;
    /// A number that the result has to exceed. The search ends with minus infinity, and no posture,
    /// once a value of the set does not.
    double above = -infinity;
  };
  struct Harmonic {
    double order = 0;  ///< cos(order q2), sin(order q2)
    Inertia cosine, sine;
  };

  explicit Postures(robot::Model of, const PostureOptions& options = {});

  /// Returns the postures about `posture` that the set represents: those of the nearest centre, or
  /// all of the robot.
  [[nodiscard]] Box box_around(const Vector& posture) const;

  /// Adds a posture that a search has to respect. Nothing is proved about it.
  void add(const Vector& posture);

  using Function = std::function<double(const Inertia&)>;

  /// Returns the smallest f over the set. @param f_up_to returns f. It may return a function that
  /// is infinite where f is above `enough`, which saves work: the value there does not matter.
  [[nodiscard]] Extreme smallest(const std::function<Function(double enough)>& f_up_to,
                                 const Search& search) const;

  robot::Model model;
  std::vector<Vector> centres;
  Vector reach;
  Kind kind = Kind::sampled;
  bool proved = false;      ///< whether the values between the postures are bounded
  double chord_factor = 0;  ///< step^2 / 8
  std::vector<Vector> q;
  std::vector<Inertia> inertia;  ///< M and C at each posture in q
  /// Harmonics of M and C without the constant; empty unless the kind is `circle` and proved.
  std::vector<Harmonic> harmonics;
};

/// Returns the smallest d <= 8 for which every multiplier of a mimic joint is a multiple of 1/d; 0:
/// none.
int multiplier_denominator(const robot::Model& model);

/// Returns for each joint the largest number of turns of a body per turn of that joint. The angles
/// of a chain of mimic joints add up.
Eigen::VectorXd most_turns(const robot::Model& model);

/// Returns number `k` of a sequence that fills the postures evenly (Kronecker's sequence with
/// powers of the generalised golden ratio). Revolute joints cover the full circle. Prismatic joints
/// cover their range; a missing bound is replaced by -1 m or 1 m.
Vector spread_posture(const robot::Model& model, int k);

/// Returns the largest f over the first `samples` postures of `spread_posture`. Refines the best
/// six postures locally within the same range. Revolute joints are returned in [-pi, pi].
Extreme largest(const robot::Model& model, const std::function<double(const Vector&)>& f,
                int samples);

}  // namespace tachless::numerics
