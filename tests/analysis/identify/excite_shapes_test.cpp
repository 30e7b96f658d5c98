// Motions of excite in which links with collision shapes stay apart.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/failure.h"
#include "identify/excite.h"
#include "reference/make_trajectory.h"
#include "robot/kinematics.h"
#include "robot/link_shapes.h"
#include "tests/analysis/identify/hidden_arm.h"

namespace tachless::identify {
namespace {

using testing::HasSubstr;

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

TEST(ExciteWithShapes, KeepsLinksApartThatNoJointConnects) {
  const scenario::Scenario arm = folding("[0, 2]");
  ExcitationGoal goal{.duration_s = 5, .reach = 1.5, .floor = {}};
  const Excitation careless = excite(arm, {Kind::viscous}, goal, ignore);
  EXPECT_LT(least_distance(arm, careless), -0.02) << "the shapes are not given";
  EXPECT_FALSE(careless.nearest);
  goal.shapes = folding_arm();
  goal.clearance = 0.03;
  const Excitation motion = excite(arm, {Kind::rotor}, goal, ignore);
  EXPECT_GT(least_distance(arm, motion), 0.03);
  EXPECT_LT(least_distance(arm, motion), 0.1) << "the motion is not smaller than it has to be";
  ASSERT_TRUE(motion.nearest);
  EXPECT_EQ(motion.nearest->a + motion.nearest->b, "baseforearm");
  EXPECT_NEAR(motion.nearest->distance, least_distance(arm, motion), 1e-3);
  EXPECT_TRUE(motion.not_compared.empty());
}

TEST(ExciteWithShapes, NamesLinksThatBeginTooNearOrMeetAtTheStart) {
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

TEST(ExciteWithShapes, RefusesAShapeWithoutASize) {
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
