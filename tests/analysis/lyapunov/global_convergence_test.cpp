// A Lagrangian system with the properties that the paper assumes of a robot, in which the law
// (4)-(5) does not converge from every start: docs/counterexample.md.
#include "lyapunov/global_convergence.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

namespace tachless::lyapunov {
namespace {

using Pair = Eigen::Vector2d;
using State = Eigen::Matrix<double, 6, 1>;  // q, v, nu

/// M(q) = diag(0.2 + 5 exp(-|q|^2), 0.2 + 5 exp(-|q|^2 / 1.69)) without gravity. Both diagonals are
/// smooth and bounded.
struct Bump {
  [[nodiscard]] static Pair inertia(const Pair& q) {
    return {0.2 + 5 * std::exp(-q.squaredNorm()), 0.2 + 5 * std::exp(-q.squaredNorm() / 1.69)};
  }
  /// Returns the gradient of each diagonal entry as a row.
  [[nodiscard]] static Eigen::Matrix2d gradient(const Pair& q) {
    Eigen::Matrix2d result;
    result.row(0) = -10 * std::exp(-q.squaredNorm()) * q.transpose();
    result.row(1) = -10 / 1.69 * std::exp(-q.squaredNorm() / 1.69) * q.transpose();
    return result;
  }
  /// Returns C(q, u) w by Christoffel's symbols.
  [[nodiscard]] static Pair coriolis(const Pair& q, const Pair& u, const Pair& w) {
    const Eigen::Matrix2d G = gradient(q);
    const Pair along_u = G * u, along_w = G * w;
    return 0.5 *
           (along_u.cwiseProduct(w) + along_w.cwiseProduct(u) - G.transpose() * u.cwiseProduct(w));
  }
};

/// The loop of the law with gains 1, 1, 2, 2 and the reference (1, 1) / sqrt 2 sin t.
struct Loop {
  double friction = 0;  ///< [N m s/rad], fed forward

  [[nodiscard]] State rate(double t, const State& x) const {
    const Pair u(std::sqrt(0.5), std::sqrt(0.5));
    const Pair q = x.head<2>(), v = x.segment<2>(2), nu = x.tail<2>();
    const Pair v_ref = u * std::cos(t), a_ref = -u * std::sin(t), M = Bump::inertia(q);
    const Pair tau = M.cwiseProduct(a_ref) + Bump::coriolis(q, v_ref, v_ref) -
                     (q - u * std::sin(t)) - nu - friction * (v - v_ref);
    State dot;
    dot << v, (tau - Bump::coriolis(q, v, v)).cwiseQuotient(M), -2 * nu + 2 * (v - v_ref);
    return dot;
  }
};

/// An explicit Runge-Kutta method: its row of stage i, and its weights.
struct Method {
  std::vector<std::vector<double>> a;
  std::vector<double> b;
};
const Method classical{{{}, {0.5}, {0, 0.5}, {0, 0, 1}}, {1. / 6, 1. / 3, 1. / 3, 1. / 6}};
/// Order five, of Dormand and Prince.
const Method order_5{{{},
                      {1. / 5},
                      {3. / 40, 9. / 40},
                      {44. / 45, -56. / 15, 32. / 9},
                      {19372. / 6561, -25360. / 2187, 64448. / 6561, -212. / 729},
                      {9017. / 3168, -355. / 33, 46732. / 5247, 49. / 176, -5103. / 18656}},
                     {35. / 384, 0, 500. / 1113, 125. / 192, -2187. / 6784, 11. / 84}};

State stepped(const Method& method, const Loop& loop, double t, const State& x, double dt) {
  std::array<State, 6> k;
  State next = x;
  for (std::size_t i = 0; i < method.b.size(); ++i) {
    State at = x;
    double c = 0;
    for (std::size_t j = 0; j < method.a[i].size(); ++j) {
      at += dt * method.a[i][j] * k[j];
      c += method.a[i][j];
    }
    k[i] = loop.rate(t + c * dt, at);
    next += dt * method.b[i] * k[i];
  }
  return next;
}

double speed(const State& x) {
  const Pair v = x.segment<2>(2);
  return std::sqrt(v.dot(Bump::inertia(x.head<2>()).cwiseProduct(v)));
}

constexpr double radius = 1.370065, length = 10.1398;  // of the closed geodesic

/// Returns the state on the closed geodesic at that speed.
State on_geodesic(double R) {
  State x = State::Zero();
  x[0] = radius;
  x[3] = R / std::sqrt(Bump::inertia({radius, 0})[1]);
  return x;
}

/// Returns the state after `seconds`, by that many steps per turn at the first speed.
State after(const Method& method, const Loop& loop, double R, double seconds, int steps_per_turn) {
  State x = on_geodesic(R);
  const double longest = length / R / steps_per_turn;
  const int steps = static_cast<int>(std::ceil(seconds / longest));
  const double dt = seconds / steps;
  for (int k = 0; k < steps; ++k) x = stepped(method, loop, k * dt, x, dt);
  return x;
}

TEST(Counterexample, HasThePropertiesOfARobot) {
  for (int k = 0; k < 100; ++k) {
    const Pair q(std::sin(1.3 * k), 2 * std::cos(0.7 * k)), u(std::cos(k), std::sin(2 * k)),
        w(std::sin(3 * k), 1);
    const Pair M = Bump::inertia(q);
    EXPECT_GT(M.minCoeff(), 0.2 - 1e-12);
    EXPECT_LT(M.maxCoeff(), 5.2 + 1e-12);
    EXPECT_LT((Bump::coriolis(q, u, w) - Bump::coriolis(q, w, u)).norm(), 1e-14);
    // w' (Mdot - 2 C(q, u)) w = 0 along u
    const Pair Mdot = Bump::gradient(q) * u;
    EXPECT_NEAR(w.dot(Mdot.cwiseProduct(w)), 2 * w.dot(Bump::coriolis(q, u, w)), 1e-13);
  }
}

/// The speed on the closed geodesic grows at the averaged rate 1/2 I / L - 1.446 kd a b / R, by two
/// methods: the loop leaves every bound that its reference would suggest.
TEST(Counterexample, GrowsFromAFastStartWithoutFriction) {
  const double R = 200, seconds = 40;
  const double by_classical = speed(after(classical, {}, R, seconds, 300));
  const double by_order_5 = speed(after(order_5, {}, R, seconds, 200));
  EXPECT_NEAR(by_classical, 201.4096, 2e-3);
  EXPECT_NEAR(by_classical, by_order_5, 1e-3);
  const double rate = 0.5 * 1.3193 / length - 4 * 1.4457 / R;
  EXPECT_NEAR((by_order_5 - R) / seconds, rate, 0.03 * rate);
}

TEST(Counterexample, ConvergesFromASlowerStartAndWithFriction) {
  EXPECT_LT(speed(after(order_5, {}, 40, 40, 100)), 39) << "below the threshold of 89";
  Loop damped;
  damped.friction = 1;
  EXPECT_LT(speed(after(order_5, damped, 200, 60, 100)), 3);
}

}  // namespace
}  // namespace tachless::lyapunov
