#include "report/report_sections.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/tools/report/count.h"

namespace tachless::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

study::Tracking run(int num_joints, bool flexible, int num_ticks = 5'000) {
  study::Tracking tracking(num_joints);
  Vector q(num_joints), q_ref(num_joints), tau(num_joints), theta;
  for (int k = 0; k < num_ticks; ++k) {
    const double t_s = k * 2.0 / num_ticks;
    for (int i = 0; i < num_joints; ++i) {
      const double phase = 2 * std::numbers::pi * (5 + i) * t_s;
      q_ref[i] = 0.03 * std::sin(phase);
      q[i] = q_ref[i] + 1e-3 * std::exp(-9 * t_s) + 1e-6 * std::cos(phase);
      tau[i] = 60.0 / (i + 1) * std::sin(phase + 0.4);
    }
    if (flexible) theta = q + 0.001 * tau;
    tracking.add(t_s, q, q_ref, theta, tau);
  }
  return tracking;
}

std::string drawn(const study::Tracking& tracking, const std::string& title, double end_s = 2) {
  const auto n = tracking.joints().size();
  robot::JointLabels joints{
      {}, std::vector<std::string>(n, "rad"), std::vector<std::string>(n, "N m")};
  for (std::size_t i = 0; i < n; ++i) joints.name.push_back(fmt::format("wrist_{}", i));
  return inline_svg(tracking_figure(tracking, title, end_s, joints), title).markup();
}

TEST(TrackingFigure, ShowsLinkReferenceErrorAndTorqueWithUnits) {
  const std::string svg = drawn(run(2, false), "paper_rigid: loria_ortega_rigid, h = 50 µs");
  for (const char* text : {"paper_rigid", "wrist_1", "time [s]", "[rad]", "[N m]", ">reference<"}) {
    EXPECT_THAT(svg, HasSubstr(text));
  }
  EXPECT_THAT(svg, Not(HasSubstr("motor")));
  EXPECT_THAT(drawn(run(2, true), "flexible"), HasSubstr(">motor<"));
}

TEST(TrackingFigure, HasAPanelForEachOfSevenJointsAndOneForErrorsAndTorques) {
  const std::string svg = drawn(run(7, false), "seven");
  EXPECT_EQ(count(svg, "overflow=\"hidden\""), 9U) << "panels";
  EXPECT_EQ(count(svg, ">reference<"), 7U);
  EXPECT_EQ(count(svg, ">link<"), 7U);
  EXPECT_EQ(count(svg, "<path "), 7U * 2 + 7 + 7) << "curves";
}

TEST(TrackingFigure, IsDrawnOfAJointThatNeverMoves) {
  study::Tracking tracking(1);
  const Vector zero = Vector::Zero(1);
  for (int k = 0; k < 10; ++k) tracking.add(k, zero, zero, {}, zero);
  const std::string svg = drawn(tracking, "it's at rest", 10);
  EXPECT_THAT(svg, HasSubstr("it&#39;s at rest"));
  EXPECT_EQ(count(svg, ">reference<"), 1U);
  EXPECT_EQ(count(svg, "[rad]"), 2U) << "the axis of errors is there, and empty";
}

TEST(TrackingFigure, CutsTheTorqueAxisAtAKickAndSaysSo) {
  study::Tracking tracking(1);
  Vector q(1), tau(1);
  q[0] = 0.1;
  for (int k = 0; k < 1000; ++k) {
    tau[0] = k == 0 ? 5000 : 10 * std::sin(0.1 * k);
    tracking.add(k * 1e-3, q, q, {}, tau);
  }
  EXPECT_THAT(drawn(tracking, "kick", 1), HasSubstr("axis cut: peak 5000 N m"));
  EXPECT_THAT(drawn(run(2, false), "calm"), Not(HasSubstr("axis cut")));
}

}  // namespace
}  // namespace tachless::report
