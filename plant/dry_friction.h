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
/// between these instants, and a joint at rest does not move. F v >= 0: friction gives no energy.
/// Gauss's principle of least constraint determines the joints that begin to slide. Its solution is
/// the unique solution of M a = r - F, |F| <= Fs, a F >= 0, with |F| < Fs only where a = 0.
/// Projected Gauss-Seidel iteration computes the solution. The class does not integrate.
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

  /// Makes moving joints slide, and joints at rest stick until `release`. Call `solve` between
  /// `stick` and `release`.
  void stick(const double* v);

  /// Makes the sticking joints slide that friction cannot hold against the torques of the last
  /// `solve`.
  void release();

  [[nodiscard]] bool sticks() const;

  /// Returns a number above 0 if the velocity `v` of a sliding joint has changed its sign. The
  /// number is also above 0 if friction cannot hold a sticking joint against the torques of the
  /// last `solve`.
  [[nodiscard]] double violation(const double* v) const;

  /// Sets the velocity to zero of each joint whose velocity has changed its sign.
  void stop(double* v) const;

 private:
  /// Relative excess over the static friction from which a sticking joint slides. The excess is
  /// above rounding. A released joint therefore moves.
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
