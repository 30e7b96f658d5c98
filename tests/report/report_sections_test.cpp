#include "report/report_sections.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "report/gnuplot.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; ++at) ++found;
  return found;
}

class Figure : public ::testing::Test {
 protected:
  static study::Tracking run(int num_joints, bool flexible, int num_ticks = 40'000) {
    study::Tracking tracking(num_joints);
    robot::Vector q(num_joints), q_ref(num_joints), tau(num_joints), theta;
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

  std::string drawn(const study::Tracking& tracking, const std::string& title,
                    double period_s = 5e-5) {
    const auto n = tracking.joints().size();
    robot::JointLabels joints{
        {}, std::vector<std::string>(n, "rad"), std::vector<std::string>(n, "N m")};
    for (std::size_t i = 0; i < n; ++i) joints.name.push_back(fmt::format("wrist_{}", i));
    const std::filesystem::path svg = directory_ / "tracking.svg";
    draw(tracking_figure(tracking, title, period_s, joints), svg);
    std::ostringstream text;
    text << std::ifstream(svg).rdbuf();
    return text.str();
  }

  TemporaryDirectory directory_;
};

TEST_F(Figure, ShowsLinkReferenceErrorAndTorqueWithUnits) {
  const std::string svg = drawn(run(2, false), "paper_rigid: loria_ortega_rigid, h = 50 µs");
  EXPECT_THAT(svg, HasSubstr("paper_rigid"));
  EXPECT_THAT(svg, HasSubstr("wrist_1"));  // not as a subscript
  EXPECT_THAT(svg, HasSubstr("time [s]"));
  EXPECT_THAT(svg, HasSubstr("[rad]"));
  EXPECT_THAT(svg, HasSubstr("[N m]"));
  EXPECT_THAT(svg, HasSubstr("reference"));
  EXPECT_THAT(svg, Not(HasSubstr("motor")));
  EXPECT_THAT(svg, HasSubstr("</svg>"));
}

TEST_F(Figure, ShowsTheMotorsOfAFlexibleRobot) {
  EXPECT_THAT(drawn(run(2, true), "flexible"), HasSubstr("motor"));
}

TEST_F(Figure, HasAPanelForEachOfSevenJointsAndOneForErrorsAndTorques) {
  const std::string svg = drawn(run(7, false, 5000), "seven", 4e-4);
  // Each panel is a plot of its own; each curve is named once in a key.
  EXPECT_EQ(count(svg, ">reference</tspan>"), 7U);
  EXPECT_EQ(count(svg, ">link</tspan>"), 7U);
  EXPECT_EQ(count(svg, "<g id=\"gnuplot_plot_"), 7U * 2 + 7 + 7) << "curves";
  // Two columns: four rows of joints, two of all joints.
  EXPECT_THAT(svg, HasSubstr("viewBox=\"0 0 900 1328\"")) << 30 + 6 * 200 + 3 * 24 + 26;
}

TEST_F(Figure, IsDrawnWhenTheErrorIsExactlyZero) {
  study::Tracking tracking(1);
  robot::Vector zero(1);
  zero[0] = 0;
  for (int k = 0; k < 10; ++k) tracking.add(k, zero, zero, {}, zero);
  const std::string svg = drawn(tracking, "it's at rest");
  EXPECT_THAT(svg, HasSubstr("it's at rest"));
  EXPECT_EQ(count(svg, ">reference</tspan>"), 1U);
  EXPECT_EQ(count(svg, "[rad]"), 2U) << "the axis of errors is there, and empty";
}

TEST_F(Figure, CutsTheTorqueAxisAtAKickAndSaysSo) {
  study::Tracking tracking(1);
  robot::Vector q(1), tau(1);
  q[0] = 0.1;
  for (int k = 0; k < 1000; ++k) {
    tau[0] = k == 0 ? 5000 : 10 * std::sin(0.1 * k);
    tracking.add(k * 1e-3, q, q, {}, tau);
  }
  EXPECT_THAT(drawn(tracking, "kick", 1e-3), HasSubstr("axis cut: peak 5000 N m"));
  EXPECT_THAT(drawn(run(2, false), "calm"), Not(HasSubstr("axis cut")));
}

TEST_F(Figure, LeavesNothingBesideThePicture) {
  drawn(run(1, false, 100), "one");
  const auto files = std::distance(std::filesystem::directory_iterator(directory_.path()),
                                   std::filesystem::directory_iterator());
  EXPECT_EQ(files, 1);
}

}  // namespace
}  // namespace tachless::report
