#include "controller/law/rivals/zhang_dawson.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/controller/law/closed_loop.h"
#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::zhang_dawson_test {
namespace {

const ZhangDawson::Gains gains{vector(150, 150)};
const State<4> beside = rigid_state({0.1, -0.1}, {0, 0});

/// The continuous-time loop in (q, v, p), with the source's signs (error = q_ref - q) and the
/// source's state p, which the law does not keep.
struct Continuous {
  TwoLink<double> arm;
  Sine reference;

  State<6> operator()(double t, const State<6>& x) const {
    const messages::ReferencePoint r = reference.at(t);
    const double k = 150;
    const Pair q = x.segment<2>(0), v = x.segment<2>(2), p = x.segment<2>(4);
    const Pair error = Pair(r.q_ref) - q, y = p - k * error;
    const Pair tanh_error = error.array().tanh();
    const Pair T = 1 - y.array().square();
    const Pair pdot = -T.cwiseProduct(y - tanh_error) - k * (tanh_error + y);
    const Pair feedforward = arm.torque(r.q_ref, r.v_ref, r.v_ref, r.a_ref);
    const Pair tau = feedforward - k * y.cwiseQuotient(T) + tanh_error;
    State<6> dot;
    dot << v, arm.acceleration(q, v, tau), pdot;
    return dot;
  }
  [[nodiscard]] State<6> from(const State<4>& x) const {
    State<6> all;
    all << x, 150 * (Pair(reference.at(0).q_ref) - x.head<2>());
    return all;
  }
};

TEST(ZhangDawson, ConvergesWithAndWithoutAPayloadThatTheModelKnows) {
  const Sine reference;
  for (const double payload : {0.0, 0.5}) {
    const Continuous exact{{payload}, reference};
    const auto states = solution(exact, exact.from(beside), 1e-3, 15000, 2.5e-4);
    // The slowest modes decay as exp(-t), whatever k: 0.1 rad is 5e-8 after 14.5 s; measured
    // 3.5e-8 and 2.6e-8.
    EXPECT_LT(final_error(states, reference, 1e-3, 500), 2e-7) << payload;
    const ZhangDawson law(model_with(payload), gains, {1e-3});
    const auto sampled =
        sampled_loop(law, beside, RigidArm{{payload}}, RigidArm::position, reference, 1e-3, 15000);
    // A feed-forward half a period old, some 10 N m/s * 0.5 ms, over a stiffness of k = 150 N
    // m/rad; measured 1.7e-5 and 1.8e-5, 6e-5 at other phases of the reference.
    EXPECT_LT(final_error(sampled, reference, 1e-3, 500), 1.2e-4) << payload;
  }
}

TEST(ZhangDawson, ApproachesItsContinuousEquationsWithFirstOrder) {
  const Sine reference{{0.3, -0.4}, 3};
  const Continuous exact{{}, reference};
  expect_first_order([](double h) { return ZhangDawson(model_with(0), gains, {h}); },
                     RigidArm::position, exact, exact.from(beside), reference, 5e-4);
}

TEST(ZhangDawson, StartsWithYZero) {
  const ZhangDawson law(two_link_model(), gains, {1e-3});
  const TwoLink<double> arm;
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const messages::PositionMeasurement measured{random.pair(3)};
    const messages::ReferencePoint ref = random.reference();
    const auto step = law.step(law.start(measured, ref), measured, ref);
    const Pair e = measured.q - ref.q_ref;
    EXPECT_EQ(step.signals.value[0], e);
    EXPECT_EQ(step.signals.value[1], vector(0, 0));
    const Pair expected =
        arm.torque(ref.q_ref, ref.v_ref, ref.v_ref, ref.a_ref) - Pair(e.array().tanh());
    // 20 roundings of terms of some 1e2 N m.
    EXPECT_LT((step.command.tau - expected).norm(), 1e-12);
  }
}

/// Uses an error that is linear in time, so that only the filter's own order is visible.
TEST(ZhangDawson, FilterHasSecondOrder) {
  const Pair from(0.2, -0.3), slope(0.6, 0.4);
  const auto rate = [&](double t, const Pair& y) -> Pair {
    const Pair tanh_e = (from + t * slope).array().tanh();
    const Pair T = 1 - y.array().square();
    return 150 * (slope + tanh_e - y) - T.cwiseProduct(y + tanh_e);
  };
  const auto exact = solution(rate, Pair(0.5, -0.5), 2e-3, 20, 2e-5);
  const Vector zero = vector(0, 0);
  const messages::ReferencePoint at_zero{zero, zero, zero, zero, zero};
  const auto error_at = [&](double h) {
    const ZhangDawson law(two_link_model(), gains, {h});
    ZhangDawson::Memory memory{vector(0.5, -0.5), from};
    double error = 0;
    const int per_row = static_cast<int>(std::lround(2e-3 / h));
    for (int k = 1; k <= 20 * per_row; ++k) {
      memory = law.step(memory, {from + k * h * slope}, at_zero).memory;
      if (k % per_row != 0) continue;
      error = std::max(error, (memory.y - exact[static_cast<std::size_t>(k / per_row)]).norm());
    }
    return error;
  };
  const double coarse = error_at(2e-3), fine = error_at(1e-3);
  EXPECT_NEAR(coarse / fine, 4, 0.4) << coarse << " " << fine;
}

TEST(ZhangDawson, HasNoFiniteTorqueWhereItIsNotDefined) {
  const ZhangDawson law(two_link_model(), gains, {1e-3});
  const Vector zero = vector(0, 0);
  const messages::ReferencePoint at_zero{zero, zero, zero, zero, zero};
  // A jump of the error by 10 mrad in a period is 10 rad/s: y goes beyond 1 and -1.
  const auto step = law.step({vector(0, 0), vector(0, 0)}, {vector(0.01, -0.01)}, at_zero);
  EXPECT_GT(step.memory.y[0], 1);
  EXPECT_LT(step.memory.y[1], -1);
  EXPECT_EQ(step.command.tau[0], -std::numeric_limits<double>::infinity());
  EXPECT_EQ(step.command.tau[1], std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace tachless::controller::law::zhang_dawson_test
