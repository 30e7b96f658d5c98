// Arms with one fault each, of which a referee said what commission should answer.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "base/failure.h"
#include "commission/commission.h"
#include "tests/tools/commission/hidden_arms.h"

namespace tachless::commission {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// Returns the scenario of an arm at rest that adds nothing, with its posture and friction.
/// @param more further overrides, which replace these
scenario::Scenario arm_like(const ArmKind& kind, const std::vector<std::string>& more) {
  std::vector<std::string> says = {
      "plant.mechanics=native",
      "plant.integrator.accuracy=1e-8",
      "plant.on_limit=warn",
      fmt::format("plant.encoder.resolution_bits={}", kind.bits),
      "loop.command_delay=1",
      "plant.drive.torque_limit_Nm=" + kind.torque_limit,
      "robot.compensates={}",
      fmt::format("plant.initial.position_rad=[{}]", fmt::join(kind.posture, ", ")),
      fmt::format("reference={{hold: {{position_rad: [{}]}}}}", fmt::join(kind.posture, ", ")),
      fmt::format("plant.drive.coulomb_friction_Nm=[{}]", fmt::join(kind.friction, ", ")),
      fmt::format("robot.joints={{rigid: {{rotor_inertia_kgm2: [{}]}}}}",
                  fmt::join(kind.rotor, ", "))};
  says.insert(says.end(), more.begin(), more.end());
  return scenario::load_scenario(
      fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, kind.scenario), says);
}

/// The maker's arm: it adds gravity, which the claimed scenario does not state.
scenario::Scenario makers(const ArmKind& kind, std::vector<std::string> more) {
  more.emplace_back("robot.compensates.gravity=true");
  return arm_like(kind, more);
}

/// The answer about an arm, and its motion.
struct Said {
  Commissioned found;
  std::string text;  ///< the misfits, or why commission ended
  Vector moved, fastest;
};

/// @param faults without a scale: torques act as they are sent
Said said_of(const scenario::Scenario& claimed, const scenario::Scenario& truth,
             DriveFaults faults) {
  if (faults.scale.size() == 0) faults.scale = Vector::Ones(truth.num_joints);
  FaultyArm arm(truth, std::move(faults));
  Said said;
  try {
    said.found = commission(claimed, trials_on(arm), [](std::string_view) {});
    said.text = fmt::format("{}", fmt::join(said.found.misfits, "; "));
  } catch (const base::Failure& failure) {
    said.text = failure.what();
  }
  said.moved = arm.moved;
  said.fastest = arm.fastest.cwiseQuotient(truth.model->velocity_limit);
  return said;
}

const ArmKind &two_link = kinds[0], &other_two_link = kinds[1];
const ArmKind& ur5e = kinds[2];

/// An arm with closed brakes holds itself without torque, and that tells nothing about gravity.
TEST(CommissionCases, ClosedBrakesSayNothingAboutGravity) {
  for (const ArmKind* kind : {&two_link, &ur5e}) {
    DriveFaults faults;
    faults.braked = true;
    const Said said = said_of(arm_like(*kind, {}), makers(*kind, {}), faults);
    EXPECT_FALSE(said.found.adds_gravity) << said.text;
    EXPECT_FALSE(said.found.unsent) << said.text;
    EXPECT_THAT(said.text, AllOf(HasSubstr("brake"), HasSubstr("moves less than")));
    for (const Commissioned::Joint& joint : said.found.joints) {
      EXPECT_EQ(joint.answers, false) << joint.name;
      EXPECT_FALSE(joint.scale) << joint.name;
    }
  }
}

/// The first trial has a hundredth of the torque.
TEST(CommissionCases, TorquesThatActAHundredfoldMoveTheArmALittle) {
  DriveFaults faults;
  faults.scale = Vector::Constant(2, 100);
  const Said said = said_of(arm_like(two_link, {}), makers(two_link, {}), faults);
  EXPECT_FALSE(said.found.adds_gravity) << said.text;
  EXPECT_THAT(said.text, Not(testing::IsEmpty()));
  EXPECT_LT(said.moved.maxCoeff(), 0.03);
  EXPECT_LT(said.fastest.maxCoeff(), 0.12);
}

TEST(CommissionCases, AFlexibleJointIsNotTakenForARigidOneAndIsSlow) {
  const std::string joints = springs(arm_like(two_link, {}), two_link, 8);
  const Said said = said_of(arm_like(two_link, {}),
                            makers(two_link, {joints, "plant.drive.coulomb_friction_Nm=0"}), {});
  EXPECT_THAT(said.text, testing::AnyOf(HasSubstr("on a spring"), HasSubstr("oscillates"),
                                        HasSubstr("not determined")));
  EXPECT_LT(said.moved.maxCoeff(), 0.03);
  EXPECT_LT(said.fastest.maxCoeff(), 0.12);
}

/// A heavier rotor and a smaller scale of torque have the same effect; the driver is not blamed.
TEST(CommissionCases, ARotorThatTheScenarioDoesNotHaveIsNoWrongGear) {
  const Said said =
      said_of(makers(two_link, {}),
              makers(two_link, {"robot.joints={rigid: {rotor_inertia_kgm2: [2, 0.4]}}"}), {});
  EXPECT_EQ(said.found.adds_gravity, true) << said.text;
  EXPECT_THAT(said.text, Not(HasSubstr("gear in the driver")));
}

TEST(CommissionCases, APayloadThatOnlyTheMakerKnowsIsNamed) {
  const Said said =
      said_of(arm_like(two_link, {}), makers(two_link, {"plant.payload={mass_kg: 3}"}), {});
  EXPECT_THAT(said.text, HasSubstr("plant.payload"));
}

/// Friction stops the joint twice in each pulse, which then looks like a swing on a spring.
TEST(CommissionCases, AReversedElbowEncoderIsNoSpring) {
  for (const ArmKind* kind : {&two_link, &other_two_link}) {
    DriveFaults faults;
    faults.encoders = Vector{{1, -1}};
    const Said said = said_of(arm_like(*kind, {}), makers(*kind, {}), faults);
    EXPECT_THAT(said.text, AllOf(HasSubstr("joint 2 (elbow) moves against its own torque"),
                                 Not(HasSubstr("spring"))));
  }
}

/// Without the rotors the wrists are 20 to 1500 times lighter than those of the arm, and friction
/// holds the joints until the pulses are strong.
TEST(CommissionCases, ABareUrdfOfAnArmWithRotorsHasNoSpring) {
  const Said said = said_of(arm_like(ur5e, {"robot.joints=rigid"}), makers(ur5e, {}), {});
  EXPECT_THAT(said.text, AllOf(HasSubstr("but the arm adds gravity"), HasSubstr("rotor_inertia"),
                               Not(HasSubstr("spring"))));
  EXPECT_EQ(said.found.adds_gravity, true);
  for (const Commissioned::Joint& joint : said.found.joints) {
    EXPECT_NEAR(joint.scale.value_or(1), 1, 0.15) << joint.name;
  }
}

/// Each joint moves by up to 2 mrad, and not along gravity.
TEST(CommissionCases, CoggingIsNotTakenForGravity) {
  DriveFaults faults;
  faults.cogging_Nm = 1;
  const Said said = said_of(arm_like(ur5e, {}), makers(ur5e, {}), faults);
  EXPECT_THAT(said.text, AllOf(HasSubstr("gravity is 16 N m"), HasSubstr("cogging")));
  EXPECT_FALSE(said.found.adds_gravity);
}

}  // namespace
}  // namespace tachless::commission
