#pragma once

#include <vector>

#include "base/quantities.h"
#include "robot/joint_friction.h"

namespace tachless::plant {

/// Dry friction of joints: Coulomb's with Stribeck's rise towards rest
/// (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994), a part that grows with the
/// load and a part that rises or falls with speed: `robot::JointFriction`.
///
/// Nothing is smoothed. A joint slides in a direction, or it sticks with an acceleration of exactly
/// zero. It changes between the two only at instants that the integrator finds. Torques are smooth
/// in between, a joint at rest stays where it is, and F v >= 0: friction gives no energy. The
/// joints that begin to slide follow from Gauss's principle of least constraint: the unique
/// solution of M a = r - F, |F| <= Fs, a F >= 0, with |F| < Fs only where a = 0. Projected
/// Gauss-Seidel iteration finds it. The class does not integrate.
class DryFriction {
  using Index = Eigen::Index;

 public:
  DryFriction() = default;  ///< none
  /// @param joints the law of each joint
  /// @throw std::logic_error if a law is not possible.
  explicit DryFriction(std::vector<robot::JointFriction> joints);

  [[nodiscard]] bool present() const { return !joints_.empty(); }
  /// Returns true if the friction of any joint grows with its load.
  [[nodiscard]] bool needs_gravity() const;

  /// Replaces rhs, all other torques at link velocity v, by the accelerations. Overwrites M, which
  /// is symmetric.
  /// @param gravity torque of gravity at each joint; null if no friction grows with the load
  /// @throw std::runtime_error if M is not positive definite.
  void solve(Matrix& M, const double* v, const double* gravity, Vector& rhs);

  /// Lets joints that move slide; joints at rest stick until `release`. Call `solve` in between.
  void stick(const double* v);

  /// Lets sticking joints slide that friction cannot hold, by the torques of the last `solve`.
  void release();

  [[nodiscard]] bool sticks() const;

  /// Returns a number above 0 if a sliding joint has turned round at `v`. It is also above 0 if
  /// friction cannot hold a sticking joint by the torques of the last `solve`.
  [[nodiscard]] double violation(const double* v) const;

  /// Sets the velocity of joints that have turned round to zero.
  void stop(double* v) const;

 private:
  /// Relative excess over the static friction from which a sticking joint slides. It is above
  /// rounding, so that a released joint does move.
  static constexpr double beyond = 1e-9;
  /// Tolerance of the iteration, relative to the static friction.
  static constexpr double converged = 1e-13;

  [[nodiscard]] bool stuck(Index i) const { return held_[i] > 0 && direction_[i] == 0; }

  std::vector<robot::JointFriction> joints_;
  Vector held_;              ///< largest friction at rest, in the posture of the last `solve`
  VectorOf<int> direction_;  ///< 0: sticks
  Matrix M_;                 ///< inertia matrix of the last `solve`, if a joint sticks
  Vector torque_;            ///< without friction first, then the holding torque of sticking joints
  Vector load_;
};

}  // namespace tachless::plant
