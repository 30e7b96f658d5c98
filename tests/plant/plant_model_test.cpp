#include "plant/plant_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "robot/dynamics.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using ::testing::HasSubstr;

scenario::Scenario scenario(const std::string& name,
                            const std::vector<std::string>& overrides = {}) {
  return scenario::load_scenario(std::string(TACHLESS_SOURCE_DIR) + "/scenarios/" + name + ".yaml",
                                 overrides);
}

TEST(PlantModel, HasTheScenariosGravityPayloadAndRotorInertia) {
  const robot::Model model = plant_model(
      scenario("paper_rigid", {"robot.gravity_m_per_s2=9.8", "plant.payload.mass_kg=0.5",
                               "robot.joints={rigid: {rotor_inertia_kgm2: [0.1, 0.2]}}"}));
  const robot::testing::TwoLinkClosedForm closed{0.5, 9.8};
  const Vector q = Eigen::Vector2d(0.7, -0.4);
  Matrix M = closed.M<double>(q);
  M(0, 0) += 0.1;
  M(1, 1) += 0.2;
  EXPECT_LT((robot::mass_matrix(model, q) - M).norm(), 1e-13);  // rounding at |M| = 10
  EXPECT_LT((robot::gravity_torque(model, q) - closed.g<double>(q)).norm(), 1e-12);
}

TEST(PlantModel, NamesAPayloadLinkThatIsNotThere) {
  scenario::Scenario s = scenario("paper_rigid", {"plant.payload.mass_kg=0.5"});
  s.plant.payload.link = "elbow_pad";
  try {
    (void)plant_model(s);
    FAIL();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("plant.payload"));
    EXPECT_THAT(failure.what(), HasSubstr("elbow_pad"));
  }
}

TEST(InitialState, PutsMotorsInStaticBalance) {
  const scenario::Scenario s = scenario(
      "paper_flexible", {"plant.initial.position_rad=[0.8, -0.3]", "plant.payload.mass_kg=0.5"});
  const robot::Model model = plant_model(s);
  Arm arm =
      make_arm(s.plant, s.robot.flexible, model, initial_state(s.plant, s.robot.flexible, model));
  EXPECT_EQ(arm.state().thetadot, Vector(Vector::Zero(2)));
  // Held by its own gravity torque, nothing moves.
  arm.advance(robot::gravity_torque(model, arm.state().q), 0.01);
  EXPECT_LT(arm.state().v.norm(), 1e-12);  // rounding: K eps / M and K eps / J for 0.01 s
  EXPECT_LT(arm.state().thetadot.norm(), 1e-12);
}

TEST(InitialState, TakesMotorsAsGiven) {
  const scenario::Scenario s =
      scenario("paper_flexible", {"plant.initial.motor_position_rad=[0.1, 0.2]",
                                  "plant.initial.motor_velocity_rad_per_s=[3, 4]"});
  const ArmState state = initial_state(s.plant, s.robot.flexible, plant_model(s));
  EXPECT_EQ(state.theta, Vector(Eigen::Vector2d(0.1, 0.2)));
  EXPECT_EQ(state.thetadot, Vector(Eigen::Vector2d(3, 4)));
}

TEST(MakeDrive, LimitsAsTheScenarioSays) {
  const auto applied = [](const std::vector<std::string>& overrides) {
    const scenario::Scenario s = scenario("paper_rigid", overrides);
    Drive drive = make_drive(s.plant, s.loop, plant_model(s));
    drive.accept({Eigen::Vector2d(1e5, -1e5)});
    return drive.applied().tau;
  };
  EXPECT_EQ(applied({}), Vector(Eigen::Vector2d(1e5, -1e5)));
  EXPECT_EQ(applied({"plant.drive.torque_limit_Nm=[100, 20]"}), Vector(Eigen::Vector2d(100, -20)));
}

TEST(MakeDrive, HoldsTheInitialPostureUntilTheFirstCommand) {
  const scenario::Scenario s =
      scenario("practical_rigid", {"plant.initial={position_rad: [0.5, 1], torque: hold}",
                                   "reference={hold: {position_rad: [0.5, 1]}}"});
  const robot::Model model = plant_model(s);
  Arm arm =
      make_arm(s.plant, s.robot.flexible, model, initial_state(s.plant, s.robot.flexible, model));
  arm.advance(make_drive(s.plant, s.loop, model).applied().tau, s.loop.period_s);
  EXPECT_LT(arm.state().v.norm(), 1e-9) << "of 5e-2 rad/s without it";
}

TEST(ProtectiveStop, BringsARobotToRest) {
  for (const char* name : {"paper_rigid", "paper_flexible"}) {
    const scenario::Scenario s =
        scenario(name, {"plant.initial.velocity_rad_per_s=[2, -3]", "robot.gravity_m_per_s2=0"});
    const robot::Model model = plant_model(s);
    Arm arm =
        make_arm(s.plant, s.robot.flexible, model, initial_state(s.plant, s.robot.flexible, model));
    arm.brake(protective_stop_damping(s.robot.flexible, model, arm.state().q));
    arm.advance(Vector::Zero(2), 2);
    EXPECT_LT(arm.state().v.norm(), 0.01) << name;  // twenty time constants of 0.1 s
  }
}

/// Moving without gravity, with a payload.
scenario::Scenario loaded_scenario(const std::string& name, std::vector<std::string> overrides) {
  overrides.insert(overrides.end(),
                   {"robot.gravity_m_per_s2=0", "loop.period_s=0.001", "loop.duration_s=0.1",
                    "plant.initial.velocity_rad_per_s=[1.5, -2]", "plant.payload.mass_kg=0.5"});
  return scenario(name, overrides);
}

TEST(PayloadWithInertia, AddsItAboutEveryJointThatTurnsIt) {
  const Vector q = Eigen::Vector2d(0.4, -1.1);
  const auto M = [&](const std::vector<std::string>& overrides) {
    return robot::mass_matrix(plant_model(loaded_scenario("paper_rigid", overrides)), q);
  };
  // Both joints of the planar arm turn about y.
  const Matrix more = M({"plant.payload.inertia_kgm2=[0.03, 0, 0, 0.02, 0, 0.04]"}) - M({});
  EXPECT_LT((more - 0.02 * Matrix::Ones(2, 2)).norm(), 1e-14);  // rounding at |M| = 10
  // The link points along -z: further out is as a longer link with the mass there.
  const Matrix out = M({"plant.payload.center_of_mass_m=[0, 0, -0.5]"}) - M({});
  EXPECT_NEAR(out(1, 1), 0.5 * (1.5 * 1.5 - 1), 1e-14);
}

}  // namespace
}  // namespace tachless::plant
