#include "reference/make_trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

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

scenario::Scenario with_reference(const std::string& reference,
                                  const std::string& duration_s = "2") {
  return scenario::parse_scenario(
      "name: swing\nrobot: {urdf: pendulum.urdf}\ncontroller: {law: a_law, gains: {}}\n"
      "loop: {duration_s: " +
          duration_s + "}\nreference: " + reference + "\n",
      pendulum, "swing.yaml");
}

std::string refusal(const std::string& reference, const std::string& duration_s = "2") {
  try {
    (void)make_trajectory(with_reference(reference, duration_s));
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
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

Motion motion(const std::string& reference, const std::string& duration_s) {
  const scenario::Scenario scenario = with_reference(reference, duration_s);
  return {scenario, make_trajectory(scenario)};
}

TEST(Motion, IsOfTheReferenceAndNotOfTheRun) {
  const std::string move = "{point_to_point: {from_rad: 0, to_rad: 1, start_s: 0.5}}";
  for (const char* run : {"2", "3600"}) {
    const Motion found = motion(move, run);
    EXPECT_EQ(found.begin_s, 0.5) << run;
    EXPECT_EQ(found.end_s, 1.5) << run;
    EXPECT_FALSE(found.repeats);
  }
  EXPECT_EQ(motion(move, "0.75").end_s, 0.75);
  EXPECT_FALSE(motion(move, "0.5").moves());
  EXPECT_FALSE(motion("{hold: {position_rad: 0.5}}", "2").moves());
  EXPECT_FALSE(motion("{point_to_point: {from_rad: 1, to_rad: 1}}", "2").moves());
  EXPECT_EQ(motion("{hold: {position_rad: 0.5}}", "2").instants(9).size(), 1U);
}

TEST(Motion, OfSinusoidsIsTheirCommonPeriodWhereTheRunHasIt) {
  const std::string sum =
      "{multi_sine: {terms: [{amplitude_rad: 0.2, frequency_hz: 0.3}, {amplitude_rad: 0.2, "
      "frequency_hz: 0.4}, {amplitude_rad: 0, frequency_hz: 0.01}]}}";
  EXPECT_NEAR(motion(sum, "1000").end_s, 10, 1e-6);  // frequencies agree to a billionth
  EXPECT_TRUE(motion(sum, "1000").repeats);
  EXPECT_EQ(motion(sum, "9").end_s, 9);
  EXPECT_FALSE(motion(sum, "9").repeats);
}

TEST(Motion, MeetsFewInstantsOfManyPeriodsAtDifferentPhases) {
  // With the sqrt(2) Hz there is no common period. 33 evenly spaced instants over 32 s would meet
  // the 1 Hz at its zeros.
  const Motion found = motion(
      "{multi_sine: {terms: [{amplitude_rad: 0.5, frequency_hz: 1}, {amplitude_rad: 0.001, "
      "frequency_hz: 1.4142135623730951}]}}",
      "32");
  double most = 0;
  const std::vector<double> all = found.instants(33);
  for (const double t_s : all) most = std::max(most, std::abs(std::sin(6.283185307179586 * t_s)));
  EXPECT_GT(most, 0.9);
  EXPECT_EQ(all.size(), 33U);
  EXPECT_EQ(all.front(), 0);
  EXPECT_EQ(all.back(), 32);
  EXPECT_TRUE(std::ranges::is_sorted(all));
  EXPECT_GE(found.closely().size(), 2000U);
}

TEST(Motion, LooksIntoAShortPieceBetweenWaypoints) {
  // If 17 instants were evenly spaced over an hour, only one, at 0, would be in the first second.
  const Motion found =
      motion("{waypoints: {time_s: [0, 1, 3600], position_rad: [0, 0, 0.5]}}", "3600");
  const std::vector<double> all = found.instants(17);
  EXPECT_GE(std::ranges::count_if(all, [](double t_s) { return t_s < 1; }), 2);
}

TEST(MakeTrajectory, RefusesToLeaveTheJointLimits) {
  EXPECT_THAT(refusal("{hold: {position_rad: -1.5}}"),
              AllOf(HasSubstr("swing.yaml:5: reference.hold"), HasSubstr("joint 1 (swing)"),
                    HasSubstr("-1.5"), HasSubstr("-1 to 2")));
  EXPECT_THAT(refusal("{sinusoid: {amplitude_rad: 2.5, frequency_hz: 1}}"),
              HasSubstr("reference.sinusoid"));
  // The motion starts inside the limits and leaves them later.
  EXPECT_THAT(refusal("{point_to_point: {from_rad: 0, to_rad: 2.5}}"),
              HasSubstr("reference.point_to_point"));
  // The motion is at 0 at every half second.
  EXPECT_THAT(refusal("{sinusoid: {amplitude_rad: 2.5, frequency_hz: 2}}", "1000"),
              HasSubstr("reference.sinusoid"));
}

}  // namespace
}  // namespace tachless::reference
