// Identification of one emulated arm whose parameters the law and the recorded scenario do not
// know.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "base/failure.h"
#include "identify/excite.h"
#include "identify/least_squares.h"
#include "plant/motion_guard.h"
#include "reference/make_trajectory.h"
#include "robot/kinematics.h"
#include "tests/analysis/identify/hidden_arm.h"
#include "tests/support/limited_elbow.h"

namespace tachless::identify {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// Parameters of the two-link arm: rotors, viscous and Coulomb friction, payload.
const Eigen::VectorXd truth = (Eigen::VectorXd(7) << 1, 0.2, 5, 1, 6, 1, 0.5).finished();

Recording hidden_run(double seconds) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", seconds);
  return record(believed, hidden(believed, truth));
}

TEST(Identify, LeastSquaresIsAStartAndOutputErrorTheAnswer) {
  const Recording run = hidden_run(3);
  const Parameters parameters(run.scenario, all);
  const Eigen::VectorXd start =
      least_squares({regression(run, parameters)}, parameters, *run.scenario.model).values;
  const Fit fit = output_error({run}, parameters, start, ignore);
  for (Eigen::Index i = 0; i < truth.size(); ++i) {
    const std::string& name = parameters.entries()[static_cast<std::size_t>(i)].name;
    EXPECT_NEAR(start[i], truth[i], 0.02 * truth[i]) << name;
    EXPECT_NEAR(fit.values[i], truth[i], 0.005 * truth[i]) << name;
    EXPECT_LT(fit.half_width[i], 0.01 * truth[i]) << name;
  }
  EXPECT_LT((fit.values - truth).norm(), 0.5 * (start - truth).norm());
  // The residual is the encoder's: a count of 2 pi / 2^20 is 6e-6 rad, and its uniform error 1.7e-6
  // rms.
  EXPECT_LT(fit.residual.maxCoeff(), 4e-6);
}

/// The recorded scenario has one tick of delay. A current loop's lag adds the fraction.
TEST(Identify, FindsTheDelayInTicksAndPartsOfOne) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", 3);
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::payload,
                                     Kind::delay};
  for (const bool lags : {false, true}) {
    scenario::Scenario plant = hidden(believed, truth);
    plant.loop.command_delay = 3;
    if (lags) plant.plant.drive.current_loop_hz = Eigen::Vector2d(400, 400);
    const Identified found = identify({record(believed, plant)}, unknown, {}, ignore);
    const Identified::Parameter& delay = found.parameters.back();
    EXPECT_EQ(delay.doubt, "");
    const double lag = 1 / (2 * std::numbers::pi * 400 * 1e-3);  // [ticks]
    // A lag is a delay to first order in its product with the frequency, here 0.4 ms at 3 Hz.
    EXPECT_NEAR(delay.value, 3 + (lags ? lag : 0), 0.05);
    EXPECT_LT(delay.half_width, 0.05);
    for (Eigen::Index i = 0; i < truth.size(); ++i) {
      EXPECT_NEAR(found.parameters[static_cast<std::size_t>(i)].value, truth[i], 0.01 * truth[i]);
    }
    EXPECT_THAT(found.overrides, Contains("plant.encoder.latency_ticks=2"));
    EXPECT_THAT(found.overrides, Contains("loop.command_delay=1"));
  }
}

/// One tick and almost one tick agree: no command acts before the end of the first tick in either
/// case.
TEST(Identify, ADelayIsContinuousAtAWholeTick) {
  const Recording run = hidden_run(2);
  const Parameters parameters(run.scenario, {Kind::delay});
  const auto residual = [&](double delay) {
    return simulated_residual(run, parameters, Eigen::VectorXd::Constant(1, delay));
  };
  // The integrator's accuracy is 1e-8.
  EXPECT_LT((residual(1) - residual(1 - 1e-6)).cwiseAbs().maxCoeff(), 1e-7);
}

/// One of 20 blocks determines nine tenths of a parameter, as the start of a run determines a
/// delay. The estimate follows that block's noise. The residual in that block therefore does not
/// measure the noise.
TEST(Identify, IntervalsHoldWhereOneBlockTellsNearlyAll) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  constexpr int rows = 1000, runs = 300;
  const auto noise = [&](double /*zero*/) { return normal(random); };
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(rows, 2).unaryExpr(noise);
  J.col(0).head(10) *= 30;
  const Eigen::Matrix2d inverse = (J.transpose() * J).inverse();
  Eigen::Array2d held = Eigen::Array2d::Zero();
  for (int run = 0; run < runs; ++run) {
    Eigen::VectorXd residual = Eigen::VectorXd::Zero(rows).unaryExpr(noise);
    const Eigen::Vector2d error = inverse * (J.transpose() * residual);
    residual -= J * error;
    const Precision found = precision(J, residual);
    held += (error.array().abs() <= found.half_width.array()).cast<double>() / runs;
  }
  // 95 % of 300, less three standard deviations of 1.3 %. The first interval has one degree of
  // freedom, so it is wider than needed.
  EXPECT_GE(held.minCoeff(), 0.91);
  EXPECT_LE(held[1], 0.99);
}

/// The arm reaches its goal within 0.1 s and rests there, so that one block of 0.2 s has all the
/// motion. The filtered rows leave that interval out.
TEST(Identify, DoubtsAnAbsurdIntervalWhereTheMotionIsInTheFirstInstants) {
  const scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/regulation.yaml",
                              {"plant.mechanics=native",
                               "plant.drive.viscous_friction_Nms_per_rad=5", "loop.duration_s=8"});
  const Identified found =
      identify({record(scenario, scenario)}, {Kind::rotor, Kind::viscous}, {}, ignore);
  for (const Identified::Parameter& each : found.parameters) {
    // An interval of 0.5 N m s about 5 would be an answer.
    if (each.half_width > 0.1 * 5) {
      EXPECT_THAT(each.doubt, HasSubstr("its interval reaches zero and is")) << each.entry.name;
    }
  }
  EXPECT_GT(found.parameters.back().half_width, 5);
}

TEST(Identify, ChecksOnDataThatWereNotUsedAndRefusesAnotherRobot) {
  const Recording run = hidden_run(2), other = hidden_run(2.5);
  const Identified found =
      identify({run}, {Kind::viscous, Kind::coulomb, Kind::payload, Kind::rotor}, {other}, ignore);
  EXPECT_TRUE(found.validated);
  for (const Identified::Check& each : found.checks) {
    EXPECT_LT(each.after, 0.02) << each.joint;
    EXPECT_GT(each.before, 2 * each.after) << each.joint;
  }
  Recording strange = other;
  strange.scenario.robot.gravity_m_per_s2 = 1.6;
  EXPECT_THROW(identify({run, strange}, all, {}, ignore), base::Failure);
}

/// A log has no offset.
TEST(Identify, RefusesToIdentifyNothing) {
  const Recording run = hidden_run(2);
  try {
    identify({run}, {Kind::offset}, {}, ignore);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("a run: nothing is left to identify"));
  }
}

/// The simulation treats static friction as Coulomb friction, so that is written.
TEST(Identify, WritesTheStaticFrictionThatItTookForCoulombs) {
  scenario::Scenario believed = scenario("practical_rigid", "20", 2);
  const Parameters parameters(believed, {Kind::coulomb});
  const Eigen::Vector2d found(5, 0.5);
  const auto is_static = testing::StartsWith("plant.drive.static_friction_Nm");
  EXPECT_THAT(parameters.overrides(believed, found), Not(Contains(is_static)));
  believed.plant.drive.static_friction_Nm = Eigen::Vector2d(1, 1);
  EXPECT_THAT(parameters.overrides(believed, found),
              Contains("plant.drive.static_friction_Nm=[5, 0.5]"));
  EXPECT_THAT(Parameters(believed, {Kind::viscous}).overrides(believed, found),
              Not(Contains(is_static)));
}

scenario::Scenario beginning_at(const std::string& position, const std::string& limit) {
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
                                 {"plant.mechanics=native", "plant.drive.torque_limit_Nm=" + limit,
                                  "plant.initial.position_rad=" + position});
}

const ExcitationGoal short_motion{.duration_s = 5, .floor = {}};

/// Gravity takes 80.7 N m of the stretched arm's shoulder torque.
TEST(Excite, KeepsToFourFifthsOfTheTorquesOrRefuses) {
  for (const double limit : {104.0, 120.0, 200.0}) {
    const scenario::Scenario arm =
        beginning_at("[1.57, 0]", "[" + std::to_string(limit) + ", 1000]");
    const Excitation motion = excite(arm, {Kind::viscous, Kind::coulomb}, short_motion, ignore);
    EXPECT_LE(motion.torque[0], 0.8 * limit);
    EXPECT_GT(motion.torque[0], 80);
  }
  try {
    excite(beginning_at("[1.57, 0]", "[95, 1000]"), {Kind::viscous}, short_motion, ignore);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(),
                HasSubstr("plant.drive.torque_limit_Nm: holding the arm at its start"));
  }
}

TEST(Excite, KeepsToFourFifthsOfASpeedLimitThatDecreasesTowardTheEndsOfTheRange) {
  const scenario::Scenario arm = with_limited_elbow(
      beginning_at("[0.25, 0]", "null"),
      R"(lower="-0.6" upper="0.6" velocity="10"/><position_based_velocity_limits )"
      R"(deceleration_limit="2" velocity_offset="0.1")");
  const Excitation found = excite(arm, {Kind::viscous}, short_motion, ignore);
  const scenario::Scenario moving =
      scenario::parse_scenario(arm.text, arm.robot.urdf_text, arm.source, found.overrides);
  const plant::MotionGuard guard(*moving.model, "");
  const reference::Trajectory trajectory = reference::make_trajectory(moving);
  double largest = 0;
  for (double t_s = 0; t_s < moving.loop.duration_s; t_s += 0.002) {
    const messages::ReferencePoint at = trajectory.at(t_s);
    if (at.v_ref[1] == 0) continue;
    largest =
        std::max(largest, std::abs(at.v_ref[1]) / guard.speed_limit(1, at.q_ref[1], at.v_ref[1]));
  }
  EXPECT_LT(largest, 0.82) << "0.8 at the instants that excite looks at";
  EXPECT_GT(largest, 0.7);
}

TEST(Excite, MovesAJointWithoutLimitsFromWhereverItBegins) {
  const Excitation motion =
      excite(beginning_at("[3, -7]", "null"), {Kind::viscous}, short_motion, ignore);
  EXPECT_GT(motion.reach.minCoeff(), 0.05);
  EXPECT_LE(motion.reach.maxCoeff(), short_motion.reach + 1e-9);
}

/// The torque noise is 4 and 1 N m.
TEST(Excite, PredictsIntervals) {
  const scenario::Scenario arm = beginning_at("[0.25, 0.2]", "[400, 100]");
  const Excitation motion = excite(arm, {Kind::rotor, Kind::viscous, Kind::coulomb},
                                   {.duration_s = 10, .floor = {}}, ignore);
  ASSERT_EQ(motion.widths.size(), 6U);
  EXPECT_EQ(motion.widths[0].name, "rotor shoulder");
  EXPECT_LT(motion.widths[0].half_width, 1);
  EXPECT_LT(motion.widths[1].half_width, 0.25);
}

/// The first joint's rotor and its link turn about one axis.
TEST(Excite, NamesWhatNoMotionShowsAlone) {
  const scenario::Scenario arm = beginning_at("[0.25, 0.2]", "[400, 100]");
  const Excitation motion =
      excite(arm, {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::inertia}, short_motion, ignore);
  EXPECT_FALSE(std::isfinite(motion.widths[0].half_width));  // rotor of the shoulder
  EXPECT_TRUE(std::isfinite(motion.widths[2].half_width));   // its viscous friction
}

TEST(Excite, KeepsLinksAboveAFloorOrRefuses) {
  const scenario::Scenario arm =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/iiwa_point_to_point.yaml",
                              {"plant.mechanics=native", "plant.drive.torque_limit_Nm=null"});
  const auto lowest = [&](const Vector& q) {
    double least = 10;
    for (const auto& [name, frame] : arm.model->frames) {
      if (frame.body >= 0) least = std::min(least, robot::frame_pose(*arm.model, frame, q).p.z());
    }
    return least;
  };
  const double start = lowest(arm.plant.initial.position_rad);
  ExcitationGoal goal{.duration_s = 5, .floor = start + 0.01};
  try {
    excite(arm, {Kind::viscous}, goal, ignore);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("no motion keeps the links' origins above"));
  }
  goal.floor = start - 0.02;
  const Excitation motion = excite(arm, {Kind::viscous}, goal, ignore);
  EXPECT_GT(motion.reach.minCoeff(), 0);
}

/// An arm that folds: its forearm, with a tool of 0.1 m at the end, turns back toward a column on
/// the base.
std::string folding_arm() {
  return R"(<robot name="folding"><link name="base">
<collision><origin xyz="0.25 0 0.2" rpy="0 0 0"/><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
</link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="50" velocity="3"/></joint>
<link name="upper"><inertial><origin xyz="0.25 0 0"/><mass value="3"/>
<inertia ixx="0.01" iyy="0.06" izz="0.06" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="forearm"/>
<origin xyz="0.5 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-3.4" upper="3.4" effort="30" velocity="3"/></joint>
<link name="forearm"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="9 9 9"/></geometry></visual>
<collision><origin xyz="0.25 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
</robot>)";
}

scenario::Scenario folding(const std::string& start) {
  const std::string text =
      "name: folding\nrobot: {name: folding, urdf: folding.urdf, joints: rigid}\n"
      "plant: {initial: {position_rad: " +
      start +
      "}}\n"
      "reference: {hold: {position_rad: " +
      start +
      "}}\n"
      "controller: {law: loria_ortega_rigid, filter: tustin, gains: {kp: [100, 100], kd: [10, 10], "
      "a: [500, 500], b: [500, 500]}}\n"
      "loop: {mode: lockstep, period_s: 1.0e-3, duration_s: 5}\n";
  return scenario::parse_scenario(text, folding_arm(), "folding.yaml", {});
}

/// Returns the least distance that the tool's and the column's surfaces have in a motion.
double least_distance(const scenario::Scenario& arm, const Excitation& motion) {
  const scenario::Scenario moving =
      scenario::parse_scenario(arm.text, arm.robot.urdf_text, arm.source, motion.overrides);
  const reference::Trajectory trajectory = reference::make_trajectory(moving);
  double least = 1;
  for (double t_s = 0; t_s < moving.loop.duration_s; t_s += 0.01) {
    const robot::Pose<double> forearm =
        robot::frame_pose(*arm.model, "forearm", trajectory.at(t_s).q_ref);
    const Eigen::Vector3d tool = forearm.R * Eigen::Vector3d(0.25, 0, 0) + forearm.p;
    least = std::min(least, std::hypot(tool.x() - 0.25, tool.y()) - 0.1);
  }
  return least;
}

TEST(LinkShapes, AreInCapsulesWithTheDistanceOfTheirSegments) {
  const std::vector<robot::Capsule> of = robot::link_capsules(
      R"(<robot name="x"><link name="a"><collision><origin xyz="0 0 1" rpy="0 1.5707963267948966 0"/>
<geometry><cylinder radius="0.1" length="2"/></geometry></collision>
<collision><geometry><mesh filename="a.stl"/></geometry></collision></link>
<link name="b"><visual><geometry><box size="0.06 2 0.08"/></geometry></visual></link>
<link name="c"><visual><geometry><mesh filename="c.stl"/></geometry></visual></link></robot>)");
  ASSERT_EQ(of.size(), 2U);
  EXPECT_LT((of[0].to - Eigen::Vector3d(1, 0, 1)).norm(), 1e-12);  // turned about y, and up by 1 m
  EXPECT_LT((of[1].to - Eigen::Vector3d(0, 1, 0)).norm(), 1e-12);
  EXPECT_NEAR(of[1].radius, 0.05, 1e-12);
  EXPECT_NEAR(robot::distance(of[0], of[1]), 0.85, 1e-12) << "segments across each other";
  robot::Capsule beside = of[0];
  beside.from += Eigen::Vector3d(3, 0, 0.4);
  beside.to += Eigen::Vector3d(3, 0, 0.4);
  EXPECT_NEAR(robot::distance(of[0], beside), std::hypot(1, 0.4) - 0.2, 1e-12) << "parallel ones";
}

TEST(Excite, KeepsLinksApartThatNoJointConnects) {
  const scenario::Scenario arm = folding("[0, 2]");
  ExcitationGoal goal{.duration_s = 5, .reach = 1.5, .floor = {}};
  const Excitation careless = excite(arm, {Kind::viscous}, goal, ignore);
  EXPECT_LT(least_distance(arm, careless), -0.02) << "the shapes are not given";
  EXPECT_FALSE(careless.nearest);
  goal.shapes = folding_arm();
  goal.clearance = 0.03;
  const Excitation motion = excite(arm, {Kind::viscous}, goal, ignore);
  EXPECT_GT(least_distance(arm, motion), 0.03);
  EXPECT_LT(least_distance(arm, motion), 0.1) << "the motion is not smaller than it has to be";
  ASSERT_TRUE(motion.nearest);
  EXPECT_EQ(motion.nearest->a + motion.nearest->b, "baseforearm");
  EXPECT_NEAR(motion.nearest->distance, least_distance(arm, motion), 1e-3);
  EXPECT_TRUE(motion.not_compared.empty());
}

TEST(Excite, NamesLinksThatBeginTooNearOrMeetAtTheStart) {
  ExcitationGoal goal{.duration_s = 5, .floor = {}, .shapes = folding_arm()};
  // The tool's centre is (0.25 + 0.25 cos q2, 0.25 sin q2) from the column's axis.
  try {
    excite(folding("[0, 2.72]"), {Kind::viscous}, goal, ignore);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("links base and forearm are 0.00462 m from each other at "
                                          "the start; begin elsewhere, or give a smaller "
                                          "--clearance than 0.02"));
  }
  const Excitation motion = excite(folding("[0, 2.9]"), {Kind::viscous}, goal, ignore);
  ASSERT_EQ(motion.not_compared.size(), 1U);
  EXPECT_EQ(motion.not_compared[0].a, "base");
  EXPECT_FALSE(motion.nearest);
}

TEST(Excite, RefusesAShapeWithoutASize) {
  ExcitationGoal goal{.duration_s = 5, .floor = {}, .shapes = folding_arm()};
  goal.shapes.replace(goal.shapes.find("radius=\"0.05\"/>"), 13, "radius=\"wide\"");
  try {
    excite(folding("[0, 2]"), {Kind::viscous}, goal, ignore);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("radius of <sphere> is \"wide\"; needed: 1 number"));
  }
}

}  // namespace
}  // namespace tachless::identify
