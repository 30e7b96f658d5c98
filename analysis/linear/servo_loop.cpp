#include "linear/servo_loop.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <random>
#include <utility>

#include "linear/linear_loop.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::linear {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The loop of the coordinates with actuators about one posture: M v' = -K q - D v - d v.
struct ServoLoop::Matrices {
  MatrixXd M;
  VectorXd K, D, d;
  bool implicit_joint_damping = true;
};

namespace {

/// Returns (A - 1) / h of the map x+ = A x of one step. The difference from 1 would lose the digits
/// of a short step.
template <class Matrices>
MatrixXd rate(const Matrices& m, ServoStep kind, double h) {
  const Eigen::Index n = m.M.rows();
  const MatrixXd one = MatrixXd::Identity(n, n);
  MatrixXd G(2 * n, 2 * n);
  if (kind == ServoStep::euler || kind == ServoStep::implicit) {
    MatrixXd inertia = m.M;
    if (kind == ServoStep::implicit || m.implicit_joint_damping) inertia.diagonal() += h * m.d;
    if (kind == ServoStep::implicit) inertia.diagonal() += h * m.D;
    const MatrixXd inverse = numerics::inverse(inertia);
    const MatrixXd by_q = -inverse * m.K.asDiagonal(), by_v = -inverse * (m.D + m.d).asDiagonal();
    G << h * by_q, one + h * by_v, by_q, by_v;
    return G;
  }
  const MatrixXd inverse = numerics::inverse(m.M);
  G << MatrixXd::Zero(n, n), one, -inverse * m.K.asDiagonal(), -inverse * (m.D + m.d).asDiagonal();
  const MatrixXd all = MatrixXd::Identity(2 * n, 2 * n);
  if (kind == ServoStep::rk4) {
    const MatrixXd Gh = G * h;
    return G * (all + Gh / 2 * (all + Gh / 3 * (all + Gh / 4)));
  }
  // x' = F x + B u without the actuators. The exponential of [F h, 1; 0, 0] has the integral of
  // exp(F h s) over s from 0 to 1 in its corner.
  MatrixXd F = MatrixXd::Zero(4 * n, 4 * n);
  F.block(0, n, n, n) = h * one;
  F.block(n, n, n, n) = -h * inverse * m.d.asDiagonal();
  F.topRightCorner(2 * n, 2 * n) = all;
  return numerics::exponential(F).topRightCorner(2 * n, 2 * n) * G;
}

/// Returns the growth of a mode: (|1 + h rate|^2 - 1) / 2h.
double growth(std::complex<double> rate, double h) { return rate.real() + h / 2 * std::norm(rate); }

/// Returns whether no mode grows, beyond the rounding of eigenvalues.
bool decays(const MatrixXd& G, double h) {
  const Eigen::VectorXcd rates = numerics::eigenvalues(G);
  const double rounding = 1e-9 * rates.cwiseAbs().maxCoeff();
  return std::ranges::all_of(rates, [&](auto each) { return growth(each, h) <= rounding; });
}

/// Returns the coordinate of `driven` that moves fastest in the mode that grows most.
int first_joint(const MatrixXd& G, double h, const std::vector<int>& driven) {
  const numerics::ComplexEigen modes = numerics::complex_eigen(G.cast<std::complex<double>>());
  Eigen::Index first = 0;
  for (Eigen::Index k = 1; k < modes.values.size(); ++k) {
    if (growth(modes.values[k], h) > growth(modes.values[first], h)) first = k;
  }
  const auto n = static_cast<Eigen::Index>(driven.size());
  Eigen::Index fastest = 0;
  (void)modes.vectors.col(first).tail(n).cwiseAbs().maxCoeff(&fastest);
  return driven[static_cast<std::size_t>(fastest)];
}

/// Halvings of a ratio of 2 that leave seven digits.
constexpr int ratio_halvings = 24;

}  // namespace

ServoLoop::ServoLoop(robot::Model model, ServoGains gains, const std::vector<Vector>& postures)
    : model_(std::move(model)), gains_(std::move(gains)), postures_(postures) {
  constexpr int spread = 300;
  for (int j = 0; j < model_.num_joints; ++j) {
    if (gains_.kp[j] != 0 || gains_.kv[j] != 0) driven_.push_back(j);
  }
  std::mt19937 random(1);
  for (int k = 0; k < spread; ++k) {
    Vector q(model_.num_joints);
    for (int j = 0; j < model_.num_joints; ++j) {
      const auto [low, high] = robot::finite_range(model_, j);
      q[j] = low + (high - low) * (random() / 4294967296.0);
    }
    postures_.push_back(q);
  }
  for (const Vector& q : postures_) {
    order_.push_back(M_.size());
    M_.push_back(robot::mass_matrix<double>(model_, q));
  }
}

ServoLoop::Matrices ServoLoop::matrices(std::size_t posture, const Change& change) const {
  const auto n = static_cast<Eigen::Index>(driven_.size());
  MatrixXd M = M_[posture];
  for (const int j : driven_) {
    const double own = model_.rotor_inertia.size() > 0 ? model_.rotor_inertia[j] : 0;
    M(j, j) += std::max(0.0, change.armature - own);
  }
  // Joints without actuators move freely: they lessen the inertia that the others see.
  const MatrixXd inverse = n < M.rows() ? numerics::inverse(M) : MatrixXd();
  Matrices m{MatrixXd(n, n), VectorXd(n), VectorXd(n), VectorXd(n), gains_.implicit_joint_damping};
  for (Eigen::Index i = 0; i < n; ++i) {
    const int j = driven_[static_cast<std::size_t>(i)];
    m.K[i] = gains_.kp[j];
    m.D[i] = change.kv_factor * gains_.kv[j];
    m.d[i] = model_.damping.size() > 0 ? model_.damping[j] : 0;
    for (Eigen::Index k = 0; k < n; ++k) {
      m.M(i, k) = (n < M.rows() ? inverse : M)(j, driven_[static_cast<std::size_t>(k)]);
    }
  }
  if (n < M.rows()) m.M = numerics::inverse(m.M);
  return m;
}

ServoLimit ServoLoop::limit(ServoStep kind) const {
  ServoLimit least{infinity, {}, -1};
  for (std::size_t k = 0; k < postures_.size(); ++k) {
    const Matrices m = matrices(k, {});
    const auto stable = [&](double h) { return decays(rate(m, kind, h), h); };
    double bad = std::min(least.step_s, longest_servo_step);
    if (k > 0 && stable(bad)) continue;
    double good = 0;
    for (double h = shortest_servo_step; h < bad; h *= 2) {
      if (stable(h)) {
        good = h;
      } else {
        bad = h;
      }
    }
    if (good > 0 && bad == longest_servo_step && stable(bad)) continue;
    least.step_s = good > 0 ? edge(good, bad, ratio_halvings, stable, Middle::geometric) : 0;
    least.posture = postures_[k];
    const double beyond = std::max(least.step_s * 1.01, shortest_servo_step);
    least.joint = first_joint(rate(m, kind, beyond), beyond, driven_);
    if (good == 0) break;
  }
  return least;
}

bool ServoLoop::is_stable(ServoStep kind, double step_s) const {
  return is_stable(kind, step_s, {});
}

bool ServoLoop::is_stable(ServoStep kind, double step_s, const Change& change) const {
  for (auto each = order_.begin(); each != order_.end(); ++each) {
    if (decays(rate(matrices(*each, change), kind, step_s), step_s)) continue;
    std::rotate(order_.begin(), each, each + 1);
    return false;
  }
  return true;
}

std::optional<double> ServoLoop::least_armature(ServoStep kind, double step_s) const {
  const auto stable = [&](double armature) { return is_stable(kind, step_s, {armature, 1}); };
  constexpr double least = 1e-6, most = 100;
  double enough = least;
  while (!stable(enough)) {
    enough *= 2;
    if (enough > most) return std::nullopt;
  }
  return enough == least ? least
                         : edge(enough, enough / 2, ratio_halvings, stable, Middle::geometric);
}

std::optional<double> ServoLoop::largest_kv_factor(ServoStep kind, double step_s) const {
  const auto stable = [&](double factor) { return is_stable(kind, step_s, {0, factor}); };
  constexpr double least = 1e-3, part = 0.8;
  double enough = 1;
  while (!stable(enough)) {
    enough *= part;
    if (enough < least) return std::nullopt;
  }
  return enough == 1 ? 1 : edge(enough, enough / part, ratio_halvings, stable, Middle::geometric);
}

Vector ServoLoop::droop() const {
  Vector most = Vector::Zero(model_.num_joints);
  for (const Vector& q : postures_) {
    const Vector gravity = robot::gravity_torque(model_, q);
    for (int j = 0; j < model_.num_joints; ++j) {
      most[j] = std::max(most[j], std::abs(gravity[j]) / gains_.kp[j]);
    }
  }
  return most;
}

}  // namespace tachless::linear
