#include "reference/make_trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

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

experiment::Scenario with_reference(const std::string& reference,
                                    const std::string& duration_s = "2") {
  return experiment::parse_scenario(
      "name: swing\nrobot: {urdf: pendulum.urdf}\ncontroller: {law: a_law, gains: {}}\n"
      "loop: {duration_s: " +
          duration_s + "}\nreference: " + reference + "\n",
      pendulum, "swing.yaml");
}

std::string refusal(const std::string& reference, const std::string& duration_s = "2") {
  try {
    (void)make_trajectory(with_reference(reference, duration_s));
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    return failure.what();
  }
  return "accepted";
}

double at(const std::string& reference, double t_s) {
  return make_trajectory(with_reference(reference)).at(t_s).q_ref[0];
}

TEST(MakeTrajectory, GivesWhatTheScenarioAsksFor) {
  EXPECT_EQ(at("{hold: {position_rad: 0.5}}", 1), 0.5);

  // sin(2 pi 0.25 + 0.1) = cos(0.1); two roundings.
  EXPECT_NEAR(at("{sinusoid: {amplitude_rad: 0.5, frequency_hz: 0.25, phase_rad: 0.1, "
                 "offset_rad: 0.2}}",
                 1),
              0.2 + 0.5 * std::cos(0.1), 4e-16);
  EXPECT_NEAR(at("{multi_sine: {offset_rad: 0.2, terms: [{amplitude_rad: 0.5, frequency_hz: 0.25, "
                 "phase_rad: 0.1}, {amplitude_rad: 0.25, frequency_hz: 0.25, phase_rad: 0.1}]}}",
                 1),
              0.2 + 0.75 * std::cos(0.1), 4e-16);

  const std::string move = "{point_to_point: {from_rad: 0, to_rad: 1, start_s: 0.5}}";
  EXPECT_EQ(at(move, 0.5), 0);
  EXPECT_EQ(at(move, 1), 0.5);
  EXPECT_EQ(at(move, 1.5), 1);

  EXPECT_NEAR(at("{waypoints: {time_s: [0, 0.7, 2], position_rad: [0, 1, -0.5]}}", 0.7), 1, 1e-13);
}

TEST(MakeTrajectory, RefusesToLeaveTheJointLimits) {
  EXPECT_THAT(refusal("{hold: {position_rad: -1.5}}"),
              AllOf(HasSubstr("swing.yaml:5: reference.hold"), HasSubstr("joint 1 (swing)"),
                    HasSubstr("-1.5"), HasSubstr("-1 to 2")));
  EXPECT_THAT(refusal("{sinusoid: {amplitude_rad: 2.5, frequency_hz: 1}}"),
              HasSubstr("reference.sinusoid"));
  // It starts inside, and leaves later.
  EXPECT_THAT(refusal("{point_to_point: {from_rad: 0, to_rad: 2.5}}"),
              HasSubstr("reference.point_to_point"));
  // At every half second it is at 0.
  EXPECT_THAT(refusal("{sinusoid: {amplitude_rad: 2.5, frequency_hz: 2}}", "1000"),
              HasSubstr("reference.sinusoid"));
}

}  // namespace
}  // namespace tachless::reference
