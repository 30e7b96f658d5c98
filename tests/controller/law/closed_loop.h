#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/controller/law/two_link.h"

/// A law in closed loop with the paper's arm, and a solver for the law's continuous-time equations.
/// Tests compare the laws with observers with this solution.
namespace tachless::controller::law {

template <int N>
using State = Eigen::Matrix<double, N, 1>;

/// Returns one step of the classical Runge-Kutta method of order four for xdot = rate(t, x).
template <class X, class Rate>
X runge_kutta_4(const Rate& rate, double t, const X& x, double dt) {
  const X a = rate(t, x), b = rate(t + dt / 2, X(x + dt / 2 * a)),
          c = rate(t + dt / 2, X(x + dt / 2 * b)), d = rate(t + dt, X(x + dt * c));
  return x + dt / 6 * (a + 2 * b + 2 * c + d);
}

/// Returns the states at 0, h, 2 h, ... of xdot = rate(t, x), in steps of at most `dt`.
template <class X, class Rate>
std::vector<X> solution(const Rate& rate, X x, double h, int ticks, double dt) {
  const int pieces = static_cast<int>(std::ceil(h / dt - 1e-9));
  std::vector<X> at = {x};
  at.reserve(static_cast<std::size_t>(ticks) + 1);
  for (int k = 0; k < ticks; ++k) {
    for (int i = 0; i < pieces; ++i) {
      x = runge_kutta_4(rate, k * h + i * (h / pieces), x, h / pieces);
    }
    at.push_back(x);
  }
  return at;
}

/// The reference amplitude sin(omega t) on both joints.
struct Sine {
  Pair amplitude = {0.5, 0.5};
  double omega = 1;

  [[nodiscard]] messages::ReferencePoint at(double t) const {
    const double w = omega, s = std::sin(w * t), c = std::cos(w * t);
    return {amplitude * s, amplitude * (w * c), amplitude * (-w * w * s),
            amplitude * (-w * w * w * c), amplitude * (w * w * w * w * s)};
  }
};

/// Returns the states at the ticks of a loop whose torque is held between them, over `ticks`
/// periods. `rate(x, tau)` is the robot and `measure(x)` the law's measurement.
template <class L, class X, class Rate, class Measure>
std::vector<X> sampled_loop(const L& law, X x, const Rate& rate, const Measure& measure,
                            const Sine& reference, double h, int ticks) {
  std::vector<X> at = {x};
  at.reserve(static_cast<std::size_t>(ticks) + 1);
  auto memory = law.start(measure(x), reference.at(0));
  for (int k = 0; k < ticks; ++k) {
    const auto step = law.step(memory, measure(x), reference.at(k * h));
    memory = step.memory;
    const Pair tau = step.command.tau;
    // The robot's fastest mode, that of the springs, is some 350 rad/s.
    x = solution([&](double /*t*/, const X& y) -> X { return rate(y, tau); }, x, h, 1, 1e-4).back();
    at.push_back(x);
  }
  return at;
}

/// The rigid arm for `sampled_loop`: x = (q, v).
struct RigidArm {
  TwoLink<double> arm;

  State<4> operator()(const State<4>& x, const Pair& tau) const {
    State<4> dot;
    dot << x.tail<2>(), arm.acceleration(x.head<2>(), x.tail<2>(), tau);
    return dot;
  }
  static messages::PositionMeasurement position(const State<4>& x) { return {x.head<2>()}; }
};

inline State<4> rigid_state(const Pair& q, const Pair& v) {
  State<4> x;
  x << q, v;
  return x;
}

/// Springs and rotors of the arm with flexible joints.
inline const Vector stiffness = vector(1e4, 8e3);
inline const Vector rotor_inertia = vector(0.1, 0.2);

/// The arm with flexible joints: x = (q, theta, v, thetadot).
struct FlexibleArm {
  TwoLink<double> arm;

  State<8> operator()(const State<8>& x, const Pair& tau) const {
    const Pair q = x.segment<2>(0), theta = x.segment<2>(2), v = x.segment<2>(4);
    const Pair spring = Pair(stiffness).cwiseProduct(theta - q);
    State<8> dot;
    dot << v, x.segment<2>(6), arm.acceleration(q, v, spring),
        (tau - spring).cwiseQuotient(Pair(rotor_inertia));
    return dot;
  }
  static messages::StateMeasurement state(const State<8>& x) {
    return {x.segment<2>(0), x.segment<2>(4), x.segment<2>(2), x.segment<2>(6)};
  }
  static messages::MotorPositionMeasurement motor(const State<8>& x) { return {x.segment<2>(2)}; }
};

/// Returns the same arm with a payload as a model of `robot/`.
inline robot::Model model_with(double payload) {
  return payload > 0 ? robot::with_payload(two_link_model(), {.mass = payload}) : two_link_model();
}

/// Returns the largest |q - q_ref| of both joints in the last `tail` of the states.
template <class X>
double final_error(const std::vector<X>& states, const Sine& reference, double h,
                   std::size_t tail) {
  double error = 0;
  for (std::size_t k = states.size() - tail; k < states.size(); ++k) {
    const Pair q_ref = reference.at(static_cast<double>(k) * h).q_ref;
    error = std::max(error, (states[k].template head<2>() - q_ref).cwiseAbs().maxCoeff());
  }
  return error;
}

/// Returns the largest distance of the arms' positions at the ticks of the coarser grid.
template <class X, class Y>
double distance(const std::vector<X>& sampled, const std::vector<Y>& continuous) {
  const std::size_t every = (continuous.size() - 1) / (sampled.size() - 1);
  double most = 0;
  for (std::size_t k = 0; k < sampled.size(); ++k) {
    most = std::max(most, (sampled[k].template head<2>() - continuous[k * every].template head<2>())
                              .cwiseAbs()
                              .maxCoeff());
  }
  return most;
}

}  // namespace tachless::controller::law
