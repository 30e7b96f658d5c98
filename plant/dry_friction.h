#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "base/elementary.h"
#include "base/quantities.h"
#include "robot/cholesky.h"

namespace tachless::plant {

/// Dry friction of joints: Coulomb's with Stribeck's rise towards rest
/// (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994):
///
///   F(v) = sign(v) (Fc + (Fs - Fc) exp(-(v/vs)^2)) for v != 0, |F| <= Fs at rest.
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
  /// @param coulomb, held Fc and Fs >= Fc [N m; N]
  /// @param stribeck vs > 0 [rad/s; m/s]
  /// @throw std::logic_error for other sizes or values.
  DryFriction(const Vector& coulomb, const Vector& held, const Vector& stribeck)
      : coulomb_(coulomb),
        held_(held),
        stribeck_(stribeck),
        direction_(VectorOf<int>::Zero(coulomb.size())) {
    if (held.size() == coulomb.size() && stribeck.size() == coulomb.size() &&
        (coulomb.array() >= 0 && held.array() >= coulomb.array() && stribeck.array() > 0).all()) {
      return;
    }
    throw std::logic_error("plant::DryFriction: 0 <= Coulomb's <= static, and a speed > 0, needed");
  }

  [[nodiscard]] bool present() const { return coulomb_.size() > 0; }

  /// Replaces rhs, all other torques at link velocity v, by the accelerations. Overwrites M, which
  /// is symmetric.
  /// @throw std::runtime_error if M is not positive definite.
  void solve(Matrix& M, const double* v, Vector& rhs) {
    const Index n = rhs.size();
    for (Index i = 0; i < coulomb_.size(); ++i) {
      const double x = v[i] / stribeck_[i];
      rhs[i] -= direction_[i] * (coulomb_[i] + (held_[i] - coulomb_[i]) * base::exp(-x * x));
    }
    const bool some = sticks();
    if (some) {
      M_ = M;
      load_ = rhs;
      for (Index i = 0; i < n; ++i) {
        if (!stuck(i)) continue;
        M.row(i).setZero();
        M.col(i).setZero();
        M(i, i) = 1;
        rhs[i] = 0;
      }
    }
    factorise(M);
    robot::solve_in_place(M, rhs);
    if (some) torque_.noalias() = load_ - M_.lazyProduct(rhs);
  }

  /// Lets joints that move slide; joints at rest stick until `release`. Call `solve` in between.
  void stick(const double* v) {
    for (Index i = 0; i < held_.size(); ++i) direction_[i] = (v[i] > 0) - (v[i] < 0);
  }

  /// Lets sticking joints slide that friction cannot hold, by the torques of the last `solve`.
  void release() {
    const Index n = held_.size();
    Index worst = 0;
    double largest = 0;
    for (Index i = 0; i < n; ++i) {
      if (!stuck(i) || std::abs(torque_[i]) <= largest * held_[i]) continue;
      largest = std::abs(torque_[i]) / held_[i];
      worst = i;
    }
    if (largest <= 1 + beyond) return;
    // a = M^-1 (load - F) minimises a' M a: each joint at rest in turn takes the F within +-Fs that
    // brings its acceleration nearest to 0.
    Matrix LD = M_, inverse = Matrix::Identity(n, n);
    factorise(LD);
    for (Index j = 0; j < n; ++j) {
      Vector column = inverse.col(j);
      robot::solve_in_place(LD, column);
      inverse.col(j) = column;
    }
    Vector a = inverse.lazyProduct(load_), F = Vector::Zero(n);
    constexpr int most = 100000;
    double change = std::numeric_limits<double>::infinity();
    for (int k = 0; k < most && change > converged; ++k) {
      change = 0;
      for (Index i = 0; i < n; ++i) {
        if (!stuck(i)) continue;
        const double next = std::clamp(F[i] + a[i] / inverse(i, i), -held_[i], held_[i]);
        change = std::max(change, std::abs(next - F[i]) / held_[i]);
        a -= (next - F[i]) * inverse.col(i);
        F[i] = next;
      }
    }
    if (change > converged) {
      throw std::runtime_error("which joints stick by friction cannot be decided");
    }
    bool none = true;
    for (Index i = 0; i < n; ++i) {
      const bool full = stuck(i) && std::abs(F[i]) == held_[i];
      if (!full || a[i] / inverse(i, i) / F[i] <= 10 * converged) continue;
      direction_[i] = F[i] > 0 ? 1 : -1;
      none = false;
    }
    // The excess is below the tolerance of the iteration.
    if (none) direction_[worst] = torque_[worst] > 0 ? 1 : -1;
  }

  [[nodiscard]] bool sticks() const {
    for (Index i = 0; i < held_.size(); ++i) {
      if (stuck(i)) return true;
    }
    return false;
  }

  /// Returns a number above 0 if a sliding joint has turned round at `v`. It is also above 0 if
  /// friction cannot hold a sticking joint by the torques of the last `solve`.
  [[nodiscard]] double violation(const double* v) const {
    double largest = -std::numeric_limits<double>::infinity();
    for (Index i = 0; i < held_.size(); ++i) {
      if (held_[i] == 0) continue;
      largest = std::max(largest, stuck(i) ? std::abs(torque_[i]) / held_[i] - (1 + beyond)
                                           : -direction_[i] * v[i]);
    }
    return largest;
  }

  /// Sets the velocity of joints that have turned round to zero.
  void stop(double* v) const {
    for (Index i = 0; i < held_.size(); ++i) {
      if (held_[i] > 0 && direction_[i] * v[i] <= 0) v[i] = 0;
    }
  }

 private:
  /// Relative excess over the static friction from which a sticking joint slides. It is above
  /// rounding, so that a released joint does move.
  static constexpr double beyond = 1e-9;
  /// Tolerance of the iteration, relative to the static friction.
  static constexpr double converged = 1e-13;

  static void factorise(Matrix& M) {
    if (robot::factorise(M) >= 0) {
      throw std::runtime_error("the inertia matrix is not positive definite");
    }
  }

  [[nodiscard]] bool stuck(Index i) const { return held_[i] > 0 && direction_[i] == 0; }

  Vector coulomb_, held_, stribeck_;
  VectorOf<int> direction_;  ///< 0: sticks
  Matrix M_;                 ///< inertia matrix of the last `solve`, if a joint sticks
  Vector torque_;            ///< without friction first, then the holding torque of sticking joints
  Vector load_;
};

}  // namespace tachless::plant
