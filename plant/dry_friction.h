#pragma once

#include <array>

#include "robot/quantities.h"

namespace tachless::plant {

/// Friction of the links' joints that does not vanish with the speed: Coulomb's with Stribeck's
/// rise towards rest (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994):
///
///   F(v) = sign(v) (Fc + (Fs - Fc) exp(-(v/vs)^2)) for v != 0, |F| <= Fs at rest.
///
/// Nothing is smoothed. A joint slides in a direction, or it sticks, and then its acceleration is
/// exactly zero; which of the two is kept between instants that the integrator finds. So the
/// torques are smooth in between, a joint at rest stays where it is, and F v >= 0 always: friction
/// takes energy and gives none. Which joints at rest begin to slide is the one solution of
/// M a = r - F, |F| <= Fs, a F >= 0 and (|F| < Fs only where a = 0) (Gauss's principle of least
/// constraint), found by projected Gauss-Seidel iteration. Does not integrate.
class DryFriction {
 public:
  DryFriction() = default;  ///< none
  /// @param coulomb, held Fc and Fs >= Fc [N m; N] @param stribeck vs > 0 [rad/s; m/s]
  /// @throw std::logic_error for other sizes or values.
  DryFriction(const robot::Vector& coulomb, const robot::Vector& held,
              const robot::Vector& stribeck);

  [[nodiscard]] bool present() const { return coulomb_.size() > 0; }

  /// rhs, all other torques at link velocity v, becomes the accelerations. M, symmetric, is
  /// overwritten. @throw std::runtime_error if it is not positive definite.
  void solve(robot::Matrix& M, const robot::Vector& v, robot::Vector& rhs);

  /// Joints that move slide, those at rest stick until `release`. Call `solve` in between.
  void stick(const double* v);
  /// Lets those slide that cannot be held, as of the last `solve`.
  void release();
  [[nodiscard]] bool sticks() const;

  /// Above 0 when a joint that slides has turned round at `v`, or one that sticks cannot be held,
  /// as of the last `solve`.
  [[nodiscard]] double violation(const double* v) const;
  /// Makes the joints stand still that have turned round.
  void stop(double* v) const;

 private:
  [[nodiscard]] bool stuck(Eigen::Index i) const {
    return held_[i] > 0 && direction_[static_cast<std::size_t>(i)] == 0;
  }

  robot::Vector coulomb_, held_, stribeck_;
  std::array<int, robot::max_joints> direction_{};  ///< 0: sticks
  robot::Matrix M_;                                 ///< of the last `solve`, if a joint sticks
  robot::Vector torque_;  ///< all but what holds the joints that stick, then that alone
  robot::Vector load_;
};

}  // namespace tachless::plant
