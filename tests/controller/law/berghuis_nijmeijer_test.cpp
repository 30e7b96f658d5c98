#include "controller/law/rivals/berghuis_nijmeijer.h"

#include <gtest/gtest.h>

#include "tests/controller/law/closed_loop.h"
#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::berghuis_nijmeijer_test {
namespace {

const BerghuisNijmeijer::Gains gains{vector(20, 20), vector(300, 60), 400};
const State<4> beside = rigid_state({0.1, -0.1}, {0, 0});

/// The continuous-time loop in (q, v, q_hat, z), by the source's equations with the closed form.
struct Continuous {
  TwoLink<double> arm;
  Sine reference;

  State<8> operator()(double t, const State<8>& x) const {
    const messages::ReferencePoint r = reference.at(t);
    const double lambda = 20, ld = 400;
    const Pair q = x.segment<2>(0), v = x.segment<2>(2), q_hat = x.segment<2>(4),
               z = x.segment<2>(6);
    const Pair q_hatdot = z + (ld + lambda) * (q - q_hat);
    const Pair v_r = Pair(r.v_ref) - lambda * (q_hat - Pair(r.q_ref));
    const Pair v_rdot = Pair(r.a_ref) - lambda * (q_hatdot - Pair(r.v_ref));
    const Pair v_0 = q_hatdot - lambda * (q - q_hat);
    const Pair tau = arm.torque(q, v_0, v_r, v_rdot) - Pair(300, 60).cwiseProduct(v_0 - v_r);
    State<8> dot;
    dot << v, arm.acceleration(q, v, tau), q_hatdot, v_rdot + ld * lambda * (q - q_hat);
    return dot;
  }
  [[nodiscard]] State<8> from(const State<4>& x) const {
    State<8> all;
    all << x, x.head<2>(), reference.at(0).v_ref;
    return all;
  }
};

TEST(BerghuisNijmeijer, ConvergesWithAndWithoutAPayloadThatTheModelKnows) {
  const Sine reference;
  for (const double payload : {0.0, 0.5}) {
    // In continuous time: poles near -20 /s, twice, so that errors of 0.1 rad and 0.5 rad/s are
    // gone after 2.5 s but for rounding (measured 6e-16); as exp(-10 t) they would be 1e-11.
    const Continuous exact{{payload}, reference};
    const auto states = solution(exact, exact.from(beside), 1e-3, 3000, 1e-4);
    EXPECT_LT(final_error(states, reference, 1e-3, 500), 1e-9) << payload;
    // Sampled at 1 kHz: half a period's change of the held torque, some 10 N m/s * 0.5 ms, over
    // Kd lambda of up to 6000 N m/rad and 1200 N m/rad; measured 3.0e-6 and 3.7e-6.
    const BerghuisNijmeijer law(model_with(payload), gains, {1e-3});
    const auto sampled =
        sampled_loop(law, beside, RigidArm{{payload}}, RigidArm::position, reference, 1e-3, 3000);
    EXPECT_LT(final_error(sampled, reference, 1e-3, 500), 1e-5) << payload;
  }
}

TEST(BerghuisNijmeijer, ApproachesItsContinuousEquationsWithFirstOrder) {
  const Sine reference{{0.3, -0.4}, 6};
  const Continuous exact{{}, reference};
  expect_first_order([](double h) { return BerghuisNijmeijer(model_with(0), gains, {h}); },
                     RigidArm::position, exact, exact.from(beside), reference, 5e-4);
}

TEST(BerghuisNijmeijer, StartsAtTheMeasuredPositionWithTheReferencesVelocity) {
  const BerghuisNijmeijer law(two_link_model(), gains, {1e-3});
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const messages::PositionMeasurement measured{random.pair(3)};
    const messages::ReferencePoint ref = random.reference();
    const auto step = law.step(law.start(measured, ref), measured, ref);
    EXPECT_EQ(step.memory.delta, vector(0, 0));
    EXPECT_EQ(step.memory.rho, vector(0, 0));
    EXPECT_EQ(step.signals.value[0], measured.q - ref.q_ref);
    EXPECT_EQ(step.signals.value[1], ref.v_ref);
  }
}

}  // namespace
}  // namespace tachless::controller::law::berghuis_nijmeijer_test
