#include "plant/dry_friction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "robot/cholesky.h"

namespace tachless::plant {
namespace {

void factorise_inertia(Matrix& M) {
  if (robot::factorise(M) >= 0) {
    throw std::runtime_error("the inertia matrix is not positive definite");
  }
}

}  // namespace

DryFriction::DryFriction(std::vector<robot::JointFriction> joints)
    : joints_(std::move(joints)),
      held_(std::ssize(joints_)),
      direction_(VectorOf<int>::Zero(std::ssize(joints_))) {
  for (Index i = 0; i < held_.size(); ++i) {
    const robot::JointFriction& joint = joints_[static_cast<std::size_t>(i)];
    if (!joint.is_possible()) {
      throw std::logic_error(
          "plant::DryFriction: 0 <= Coulomb's <= static, -Coulomb's <= rise, speeds > 0, and "
          "static > 0 where friction grows with the load, needed");
    }
    held_[i] = joint.held;
  }
}

bool DryFriction::needs_gravity() const {
  return std::ranges::any_of(joints_, [](const auto& joint) { return joint.load > 0; });
}

void DryFriction::solve(Matrix& M, const double* v, const double* gravity, Vector& rhs) {
  const Index n = rhs.size();
  for (Index i = 0; i < held_.size(); ++i) {
    const robot::JointFriction& joint = joints_[static_cast<std::size_t>(i)];
    const double load = gravity == nullptr ? 0 : gravity[i];
    held_[i] = joint.holding(load);
    rhs[i] -= joint.sliding(v[i], direction_[i], load);
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
  factorise_inertia(M);
  robot::solve_in_place(M, rhs);
  if (some) torque_.noalias() = load_ - M_.lazyProduct(rhs);
}

void DryFriction::stick(const double* v) {
  for (Index i = 0; i < held_.size(); ++i) direction_[i] = (v[i] > 0) - (v[i] < 0);
}

void DryFriction::release() {
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
  factorise_inertia(LD);
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

bool DryFriction::sticks() const {
  for (Index i = 0; i < held_.size(); ++i) {
    if (stuck(i)) return true;
  }
  return false;
}

double DryFriction::violation(const double* v) const {
  double largest = -std::numeric_limits<double>::infinity();
  for (Index i = 0; i < held_.size(); ++i) {
    if (held_[i] == 0) continue;
    largest = std::max(
        largest, stuck(i) ? std::abs(torque_[i]) / held_[i] - (1 + beyond) : -direction_[i] * v[i]);
  }
  return largest;
}

void DryFriction::stop(double* v) const {
  for (Index i = 0; i < held_.size(); ++i) {
    if (held_[i] > 0 && direction_[i] * v[i] <= 0) v[i] = 0;
  }
}

}  // namespace tachless::plant
