// The payload that comes and goes; what else the emulator does has tests of its own.
#include "plant/emulated_robot.h"

#include <gtest/gtest.h>

#include "robot/energy.h"
#include "robot/mass_matrix.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using robot::Vector;

experiment::Scenario scenario(const std::string& name, std::vector<std::string> overrides) {
  overrides.insert(overrides.end(),
                   {"robot.gravity_m_per_s2=0", "loop.period_s=0.001", "loop.duration_s=0.1",
                    "plant.initial.velocity_rad_per_s=[1.5, -2]", "plant.payload.mass_kg=0.5"});
  return experiment::load_scenario(
      std::string(TACHLESS_SOURCE_DIR) + "/scenarios/" + name + ".yaml", overrides);
}

double kinetic(double payload, const ArmState& state) {
  const robot::testing::TwoLinkClosedForm closed{payload};
  return state.v.dot(closed.M<double>(state.q) * state.v) / 2;
}

class Payload : public ::testing::TestWithParam<double> {};

TEST_P(Payload, ThatIsAttachedAtRestKeepsTheMomentumAndReleasedKeepsTheVelocity) {
  const double attach_s = GetParam(), release_s = attach_s + 0.02;
  const experiment::Scenario s =
      scenario("paper_rigid", {"plant.payload.attach_s=" + std::to_string(attach_s),
                               "plant.payload.release_s=" + std::to_string(release_s)});
  const robot::Model model = plant_model(s);
  EmulatedRobot robot(s, model);
  const Vector zero = Vector::Zero(2);
  // Between two such instants velocities change by 1e-8 s times accelerations of some 10 rad/s^2.
  constexpr double moment_s = 1e-8, tolerance = 1e-6;
  robot.hold(zero, attach_s - moment_s);
  const ArmState before = robot.read();
  robot.hold(zero, attach_s + moment_s);
  const ArmState loaded = robot.read();
  const auto M = [&](double mp) {
    return robot::testing::TwoLinkClosedForm{mp}.M<double>(before.q);
  };
  EXPECT_LT((M(0.5) * loaded.v - M(0) * before.v).norm(), tolerance);
  EXPECT_GT((loaded.v - before.v).norm(), 0.1);
  EXPECT_LT(kinetic(0.5, loaded), kinetic(0, before));  // a plastic impact loses energy

  robot.hold(zero, release_s - moment_s);
  const ArmState carried = robot.read();
  EXPECT_NEAR(kinetic(0.5, carried), kinetic(0.5, loaded), 1e-6);
  robot.hold(zero, release_s + moment_s);
  EXPECT_LT((robot.read().v - carried.v).norm(), tolerance);
  robot.hold(zero, release_s + 0.02);
  EXPECT_NEAR(kinetic(0, robot.read()), kinetic(0, carried), 1e-6);
}

// At the beginning of a tick, and within one.
INSTANTIATE_TEST_SUITE_P(, Payload, ::testing::Values(0.03, 0.0304));

TEST(PayloadOfFlexibleJoints, StopsNoMotorWhenItIsAttached) {
  const experiment::Scenario s =
      scenario("paper_flexible",
               {"plant.payload.attach_s=0.01", "plant.initial.motor_velocity_rad_per_s=[1.5, -2]"});
  const robot::Model model = plant_model(s);
  EmulatedRobot robot(s, model);
  robot.hold(Vector::Zero(2), 0.01);
  const ArmState before = robot.read();
  robot.hold(Vector::Zero(2), 0.01 + 1e-8);
  const ArmState loaded = robot.read();
  EXPECT_GT((loaded.v - before.v).norm(), 0.1);
  EXPECT_LT((loaded.thetadot - before.thetadot).norm(), 1e-3);  // 1e-8 s of K (theta - q) / J
}

TEST(PayloadWithInertia, AddsItAboutEveryJointThatTurnsIt) {
  const Vector q = Eigen::Vector2d(0.4, -1.1);
  const auto M = [&](const std::vector<std::string>& overrides) {
    return robot::mass_matrix(plant_model(scenario("paper_rigid", overrides)), q);
  };
  // Both joints of the planar arm turn about y.
  const robot::Matrix more = M({"plant.payload.inertia_kgm2=[0.03, 0, 0, 0.02, 0, 0.04]"}) - M({});
  EXPECT_LT((more - 0.02 * robot::Matrix::Ones(2, 2)).norm(), 1e-14);  // rounding at |M| = 10
  // The link points along -z: further out is as a longer link with the mass there.
  const robot::Matrix out = M({"plant.payload.center_of_mass_m=[0, 0, -0.5]"}) - M({});
  EXPECT_NEAR(out(1, 1), 0.5 * (1.5 * 1.5 - 1), 1e-14);
}

}  // namespace
}  // namespace tachless::plant
