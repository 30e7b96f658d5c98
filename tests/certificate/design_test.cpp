#include "certificate/design.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>

#include "certificate/stability_certificate.h"
#include "controller/registry.h"
#include "experiment/scenario.h"
#include "study/in_process_loop.h"
#include "tests/certificate/scenarios.h"
#include "tests/robot/robots.h"

namespace tachless::certificate {
namespace {

using namespace testing;
using ::testing::HasSubstr;

/// The scenario with the gains of a design.
experiment::Scenario with_gains(experiment::Scenario scenario, const Design& design) {
  scenario.controller.gains = design.gains;
  return scenario;
}

/// A scenario for a robot's bare URDF.
experiment::Scenario bare(const robot::Model& model, const std::string& urdf_text) {
  return experiment::parse_scenario(experiment::urdf_scenario(model, "bare", "robot.urdf", 1e-3),
                                    urdf_text, "bare");
}

/// When a joint's error is last above 1 % of its peak, in a run from a small error.
double observed_settling(experiment::Scenario scenario) {
  robot::Vector& q = scenario.plant.initial.position_rad;
  if (q.size() == 0) q = robot::Vector::Zero(scenario.num_joints);
  q.array() += 1e-2;
  robot::Vector peak = robot::Vector::Zero(scenario.num_joints);
  double last_above = 0;
  study::run_in_process(scenario, [&](const study::TickRecord& tick) {
    const robot::Vector e = (tick.truth.q - tick.reference.q_ref).cwiseAbs();
    peak = peak.cwiseMax(e);
    if ((e.array() > 0.01 * peak.array()).any()) last_above = tick.time_s;
    return true;
  });
  return last_above;
}

TEST(Design, OfAHeldTwoLinkArmSettlesAsPredicted) {
  const experiment::Scenario scenario =
      shipped("regulation", {"loop.command_delay=1", "reference.hold.position_rad=[0, 0]"});
  DesignGoal goal;
  goal.settling_s = 0.4;
  const Design found = design(scenario, goal);
  EXPECT_FALSE(found.missed);
  EXPECT_GE(found.modulus, 0.5);
  EXPECT_GE(found.gain_margin, 1.5);
  EXPECT_NEAR(found.settling_s, 0.4, 0.02);
  EXPECT_NEAR(observed_settling(with_gains(scenario, found)), found.settling_s,
              0.2 * found.settling_s);
}

TEST(Design, OfFlexibleJointsSettlesAsPredicted) {
  const std::vector<std::string> held = {"reference.hold.position_rad=[0, 0]"};
  DesignGoal through_springs;  // a motor's filter lags too much at 1 kHz for a larger margin
  through_springs.modulus = 0.3;
  through_springs.bandwidth_hz = 1;
  const std::pair<experiment::Scenario, DesignGoal> cases[] = {
      {shipped("practical_flexible",
               {"reference={hold: {position_rad: [0, 0]}}", "loop.duration_s=1"}),
       {}},
      {shipped("flexible_regulation", held), through_springs}};
  for (const auto& [scenario, goal] : cases) {
    SCOPED_TRACE(scenario.controller.law);
    const Design found = design(scenario, goal);
    EXPECT_GE(found.modulus, goal.modulus);
    EXPECT_GE(found.gain_margin, 1.5);
    EXPECT_NEAR(observed_settling(with_gains(scenario, found)), found.settling_s,
                0.2 * found.settling_s);
  }
}

/// With a slower filter the same kp and kd settle as fast here, and certify less.
TEST(Design, ChoosesTheLargestCertifiedRegionAmongEquallyFastGains) {
  const experiment::Scenario scenario = shipped("practical_rigid");
  const Design found = design(scenario, {});
  const auto region = region_to_compare(with_gains(scenario, found));
  ASSERT_TRUE(region);
  EXPECT_EQ(found.certified_error, region->e_at_rest);
  experiment::Scenario slower = with_gains(scenario, found);
  for (const char* pole : {"a", "b"}) {
    slower.controller.gains[pole] = robot::Vector::Constant(2, 4 * found.w);
  }
  const double settling = verdict(slower).settles_s;
  EXPECT_LT(settling, 1.05 * found.settling_s);
  const auto smaller = region_to_compare(slower);
  ASSERT_TRUE(smaller);
  for (int i = 0; i < 2; ++i) EXPECT_GT(region->e_at_rest[i], smaller->e_at_rest[i]);
  // Of a constant reference there is no largest region.
  EXPECT_EQ(design(shipped("regulation"), {}).certified_error.size(), 0);
}

TEST(Design, OfABareUrdfFollowsItsReference) {
  const experiment::Scenario scenario =
      bare(robot::testing::two_link(), shipped("paper_rigid").robot.urdf_text);
  const Design found = design(scenario, {});
  double worst = 0;
  study::run_in_process(with_gains(scenario, found), [&](const study::TickRecord& tick) {
    worst = std::max(worst, (tick.truth.q - tick.reference.q_ref).cwiseAbs().maxCoeff());
    return true;
  });
  // The motion is 0.3 rad; a tick late at its peak speed of 0.37 rad/s is 4e-4 rad.
  EXPECT_LT(worst, 4e-3);
}

TEST(Design, OfTheBareIiwaSettlesAsPredictedAndHoldsWithMoreLoopGain) {
  experiment::Scenario scenario =
      bare(robot::testing::iiwa7(), shipped("iiwa_point_to_point").robot.urdf_text);
  const Design found = design(scenario, {});
  EXPECT_GE(found.modulus, 0.5);
  EXPECT_GE(found.gain_margin, 1.5);
  scenario = with_gains(scenario, found);
  const auto& motion = std::get<reference::trajectory::PointToPoint>(scenario.reference);
  for (const robot::Vector& q : {motion.from_rad, motion.to_rad}) {
    experiment::Scenario held = scenario;
    held.reference = reference::trajectory::Hold{q};
    held.plant.initial.position_rad = q;
    held.loop.duration_s = 4;
    // The prediction is of small errors, of the slowest of five postures.
    EXPECT_NEAR(observed_settling(held), found.settling_s, 0.2 * found.settling_s);
    for (const char* gain : {"kp", "kd"}) held.controller.gains[gain] *= 1.5;
    EXPECT_LT(observed_settling(held), 1.2 * found.settling_s);
  }
}

TEST(Design, OfComputedTorqueIsInAccelerations) {
  const experiment::Scenario scenario =
      shipped("practical_rigid", {"controller.law=computed_torque", "loop.command_delay=1"});
  DesignGoal goal;
  goal.bandwidth_hz = 5;
  const Design found = design(scenario, goal);
  EXPECT_EQ(found.gains.at("kp")[0], found.gains.at("kp")[1]);
  EXPECT_NEAR(found.gains.at("kp")[0], found.w * found.w, 1e-9 * found.w * found.w);
}

TEST(Design, TunesEstimatorsAndObserversWithTheLaw) {
  for (const std::string law : {"numerical_difference", "kalman_velocity", "nicosia_tomei"}) {
    SCOPED_TRACE(law);
    const experiment::Scenario scenario =
        shipped("practical_rigid", {"controller.law=" + law, "loop.command_delay=1"});
    DesignGoal goal;
    goal.bandwidth_hz = 5;
    const Design found = design(scenario, goal);
    EXPECT_GE(found.modulus, 0.5);
    EXPECT_LT(found.settling_s, 1);
    EXPECT_EQ(found.gains.size(), controller::law_facts(law).parameters.size());
  }
}

TEST(Design, RefusesALawThatCannotBeLinearised) {
  try {
    design(shipped("practical_rigid", {"controller.law=robust_differentiator"}), {});
    FAIL();
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::check_said_no);
    EXPECT_THAT(failure.what(), HasSubstr("robust_differentiator cannot be linearised"));
    EXPECT_THAT(failure.what(), HasSubstr("tune it by hand"));
  }
}

TEST(Design, SaysWhatBindsAndWhyItCannot) {
  const experiment::Scenario weak = shipped("regulation", {"reference.hold.position_rad=[1.5, 0]",
                                                           "plant.drive.torque_limit_Nm=[30, 30]"});
  try {
    design(weak, {});
    FAIL() << "gravity is beyond the limit";
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::check_said_no);
    EXPECT_THAT(failure.what(), HasSubstr("to stand still"));
  }
  DesignGoal quiet;
  quiet.count_share = 1e-12;
  try {
    design(shipped("regulation",
                   {"plant.drive.torque_limit_Nm=[300, 100]", "plant.encoder.resolution_bits=20"}),
           quiet);
    FAIL() << "a count of any gains is beyond that";
  } catch (const diagnostics::Failure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("one encoder count on joint 1 (shoulder) binds"));
  }
  DesignGoal fast;
  fast.bandwidth_hz = 200;  // at 1 kHz with a tick of delay
  const Design found = design(shipped("regulation", {"loop.command_delay=1"}), fast);
  EXPECT_LT(found.w, 2 * 3.14 * 200);
  EXPECT_THAT(found.binds, HasSubstr("margin at q = ["));
}

}  // namespace
}  // namespace tachless::certificate
