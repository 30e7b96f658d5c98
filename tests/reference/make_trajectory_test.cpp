#include "reference/make_trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

namespace tachless::reference {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// A pendulum that may swing from -1 to 2 rad.
constexpr const char* pendulum = R"(<robot name="pendulum">
  <link name="ground"/>
  <link name="bob"><inertial><origin xyz="0 0 -1"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="swing" type="revolute"><parent link="ground"/><child link="bob"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="10" velocity="10"/></joint>
</robot>)";

robot::Vector one(double x) { return robot::Vector::Constant(1, x); }

experiment::Scenario with_reference(experiment::ReferenceSpec spec) {
  experiment::Scenario scenario;
  scenario.source = "swing.yaml";
  scenario.num_joints = 1;
  scenario.robot.urdf_text = pendulum;
  scenario.robot.urdf_path = "pendulum.urdf";
  scenario.loop.duration_s = 2;
  scenario.reference = std::move(spec);
  return scenario;
}

std::string refusal(experiment::ReferenceSpec spec) {
  try {
    make_trajectory(with_reference(std::move(spec)));
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    return failure.what();
  }
  return "accepted";
}

TEST(MakeTrajectory, GivesWhatTheScenarioAsksFor) {
  EXPECT_EQ(make_trajectory(with_reference(experiment::Hold{one(0.5)})).at(1).q_ref, one(0.5));

  const experiment::Sinusoid sinusoid{one(0.5), one(0.25), one(0.1), one(0.2)};
  // sin(2 pi 0.25 + 0.1) = cos(0.1); two roundings.
  EXPECT_NEAR(make_trajectory(with_reference(sinusoid)).at(1).q_ref[0], 0.2 + 0.5 * std::cos(0.1),
              4e-16);

  const experiment::MultiSine two{
      one(0.2),
      {{one(0.5), one(0.25), one(0.1), one(0)}, {one(0.25), one(0.25), one(0.1), one(0)}}};
  EXPECT_NEAR(make_trajectory(with_reference(two)).at(1).q_ref[0], 0.2 + 0.75 * std::cos(0.1),
              4e-16);

  const experiment::PointToPoint move{one(0), one(1), 0.5, 1};
  EXPECT_EQ(make_trajectory(with_reference(move)).at(0.5).q_ref, one(0));
  EXPECT_EQ(make_trajectory(with_reference(move)).at(1).q_ref, one(0.5));
  EXPECT_EQ(make_trajectory(with_reference(move)).at(1.5).q_ref, one(1));

  const experiment::Waypoints path{{0, 0.7, 2}, {one(0), one(1), one(-0.5)}};
  EXPECT_NEAR(make_trajectory(with_reference(path)).at(0.7).q_ref[0], 1, 1e-13);
}

TEST(MakeTrajectory, RefusesWhatMakesNoSense) {
  EXPECT_THAT(refusal(experiment::PointToPoint{one(0), one(1), 0, 0}),
              AllOf(HasSubstr("swing.yaml"), HasSubstr("reference.point_to_point.duration_s"),
                    HasSubstr("greater than 0")));
  EXPECT_THAT(refusal(experiment::Waypoints{{0, 1, 0.5}, {one(0), one(1), one(0)}}),
              AllOf(HasSubstr("reference.waypoints.time_s"), HasSubstr("time 3 (0.5 s)"),
                    HasSubstr("strictly increasing")));
  EXPECT_THAT(refusal(experiment::Hold{robot::Vector::Zero(2)}),
              AllOf(HasSubstr("reference.hold.position_rad"), HasSubstr("needed: one per joint")));
}

TEST(MakeTrajectory, RefusesToLeaveTheJointLimits) {
  EXPECT_THAT(refusal(experiment::Hold{one(-1.5)}),
              AllOf(HasSubstr("reference.hold"), HasSubstr("joint 1 (swing)"), HasSubstr("-1.5"),
                    HasSubstr("-1 to 2")));
  EXPECT_THAT(refusal(experiment::Sinusoid{one(2.5), one(1), one(0), one(0)}),
              HasSubstr("reference.sinusoid"));
  // It starts inside, and leaves later.
  EXPECT_THAT(refusal(experiment::PointToPoint{one(0), one(2.5), 0, 1}),
              HasSubstr("reference.point_to_point"));
}

}  // namespace
}  // namespace tachless::reference
