#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/controller/law/closed_loop.h"

/// Comparison of a law's sampled loop with the continuous-time loop that it approaches as the
/// period goes to 0. The test itself gives the equations of the continuous loop.
namespace tachless::controller::law {

inline messages::StateMeasurement full_state(const State<4>& x) {
  return {x.head<2>(), x.tail<2>(), {}, {}};
}

/// Returns M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd (v_hat - v_ref) by the closed form.
inline Pair wen_bayard_torque(const messages::ReferencePoint& r, const Pair& q, const Pair& v_hat,
                              const Pair& kp, const Pair& kd) {
  const Pair v_ref = r.v_ref, a_ref = r.a_ref, e = q - Pair(r.q_ref);
  return TwoLink<double>().torque(q, v_ref, v_ref, a_ref) - kp.cwiseProduct(e) -
         kd.cwiseProduct(v_hat - v_ref);
}

/// Checks over 1 s that halving the period halves the sampled loop's distance from the continuous
/// one. The reason is that a held torque is, on average, half a period old. `law_at(period_s)`
/// makes the law. `rate(t, x)` is the continuous loop, with x = (q, v, memory) from x0 on.
template <class LawAt, class Measure, class Rate, int N>
void expect_first_order(const LawAt& law_at, const Measure& measure, const Rate& rate,
                        const State<N>& x0, const Sine& reference, double coarsest_s) {
  const int ticks = static_cast<int>(std::llround(1 / coarsest_s));
  // Poles of up to 300 1/s: the error is (300 dt)^4 of the motion, less than 1e-6 of the effect of
  // sampling.
  const auto exact = solution(rate, x0, coarsest_s / 4, 4 * ticks, 1e-4);
  double error[3] = {};
  for (int i = 0; i < 3; ++i) {
    const double h = coarsest_s / (1 << i);
    error[i] = distance(sampled_loop(law_at(h), State<4>(x0.template head<4>()), RigidArm{},
                                     measure, reference, h, ticks << i),
                        exact);
  }
  const double first = std::log2(error[0] / error[1]), second = std::log2(error[1] / error[2]);
  ::testing::Test::RecordProperty("order", std::to_string(first) + " " + std::to_string(second));
  // The order is 1 plus the effect of the second-order term at these periods, which must shrink
  // with h.
  EXPECT_NEAR(second, 1, 0.15) << error[0] << " " << error[1] << " " << error[2];
  EXPECT_LT(std::abs(second - 1), std::abs(first - 1) + 0.02);
}

/// Returns the rate of `wen_bayard`, which has no memory.
struct WenBayardLoop {
  Pair kp, kd;
  Sine reference;

  State<4> operator()(double t, const State<4>& x) const {
    const Pair q = x.head<2>(), v = x.tail<2>();
    return RigidArm{}(x, wen_bayard_torque(reference.at(t), q, v, kp, kd));
  }
};

}  // namespace tachless::controller::law
