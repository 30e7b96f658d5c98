#include "plant/disturbances.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "plant/arm.h"
#include "plant/encoder.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using std::numbers::pi;

constexpr double I = 0.5, h = 1e-3, T = 3;

DisturbanceSpec on_the_axle(DisturbanceShape shape, double start_s, std::optional<double> end_s) {
  DisturbanceSpec spec;
  spec.joint = "axle";
  spec.torque_Nm = T;
  spec.shape = shape;
  spec.start_s = start_s;
  spec.end_s = end_s;
  return spec;
}

/// A disc under such a disturbance and no other torque, with either mechanics.
class Disturbed : public ::testing::TestWithParam<Mechanics> {
 protected:
  ArmState after(const DisturbanceSpec& spec, double end_s) {
    const std::vector<DisturbanceSpec> specs = {spec};
    Disturbances disturbances(specs, h, model_);
    ArmOptions options;
    options.mechanics = GetParam();
    options.accuracy = 1e-10;
    options.disturbances = &disturbances;
    Arm arm(model_, options, testing::rigid_state(Vector::Zero(1), Vector::Zero(1)));
    for (int k = 1; k * h < end_s + h / 2; ++k) arm.advance(Vector::Zero(1), k * h);
    return arm.state();
  }

  robot::Model model_ = testing::turntable(I);
};

// Below: a hundred or so steps of accuracy 1e-10.
constexpr double accuracy = 1e-8;

TEST_P(Disturbed, ByAConstantTorqueFromAndToInstantsWithinATick) {
  constexpr double from = 0.0203, to = 0.0817, end = 0.1;
  const ArmState state = after(on_the_axle(DisturbanceShape::constant, from, to), end);
  const double v = T / I * (to - from);
  EXPECT_NEAR(state.v[0], v, accuracy);
  EXPECT_NEAR(state.q[0], v * (to - from) / 2 + v * (end - to), accuracy);
}

TEST_P(Disturbed, ByAPulseGainsItsImpulse) {
  constexpr double from = 0.0203, to = 0.0317;
  const ArmState state = after(on_the_axle(DisturbanceShape::pulse, from, to), 0.1);
  EXPECT_NEAR(state.v[0], T * 2 / pi * (to - from) / I, accuracy);
}

TEST_P(Disturbed, ByASinusoidFollowsItsIntegral) {
  DisturbanceSpec spec = on_the_axle(DisturbanceShape::sinusoid, 0.0205, {});
  spec.frequency_hz = 12;
  spec.phase_rad = 0.7;
  const double w = 2 * pi * 12, t = 0.2 - 0.0205;
  EXPECT_NEAR(after(spec, 0.2).v[0], T / (I * w) * (std::cos(0.7) - std::cos(w * t + 0.7)),
              accuracy);
}

INSTANTIATE_TEST_SUITE_P(, Disturbed, ::testing::Values(Mechanics::simbody, Mechanics::native),
                         testing::name_of_mechanics);

TEST(Disturbances, TellTheSumOfThoseThatActAtTheBeginningOfATick) {
  const robot::Model model = testing::turntable(I);
  DisturbanceSpec force;
  force.link = "disc";
  force.force_N = {0, 2, 0};
  force.point_m = {0.5, 0, 0};
  const std::vector<DisturbanceSpec> specs = {on_the_axle(DisturbanceShape::constant, 0.01, 0.02),
                                              force};
  Disturbances disturbances(specs, h, model);
  const auto torque = [&](double t_s, double q) {
    return disturbances.at(t_s, Vector::Constant(1, q))[0];
  };
  EXPECT_DOUBLE_EQ(torque(0.009, 0), 1);
  EXPECT_DOUBLE_EQ(torque(10 * h, 0), 1 + T);
  EXPECT_DOUBLE_EQ(torque(20 * h, 0), 1);
  EXPECT_NEAR(torque(0, pi / 3), 0.5, 1e-15);  // the lever turns, the force does not
}

}  // namespace
}  // namespace tachless::plant
