#include "report/chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "report/gnuplot.h"
#include "tests/support/damaged_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string drawn(const Chart& chart) {
  const TemporaryDirectory directory;
  draw(chart_commands({chart}), directory / "chart.svg");
  return logger::read_file(directory / "chart.svg");
}

Chart swing() {
  Chart chart;
  chart.name = "swing";
  chart.y_label = "{/:Italic q}_{1}  [rad]";
  chart.x_range = {{0, 1}};
  Curve curve{"link", {}, "#0072B2", 1.4, ""};
  for (int k = 0; k < 100; ++k) curve.points.push_back({k * 0.01, std::sin(k * 0.2)});
  chart.curves = {curve};
  return chart;
}

TEST(Chart, DrawsCurvesLevelsMarksAndNote) {
  Chart chart = swing();
  chart.levels = {0.5};
  chart.marks = {{0.2, 0.4, "#E69F00"}};
  chart.note = "axis cut: it's {here}";
  const std::string svg = drawn(chart);
  EXPECT_THAT(svg, HasSubstr("viewBox=\"0 0 520 300\""));
  EXPECT_THAT(svg, HasSubstr("link"));
  EXPECT_THAT(svg, HasSubstr("[rad]"));
  EXPECT_THAT(svg, HasSubstr("it's {here}"));
  EXPECT_THAT(svg, HasSubstr("rgb(230, 159,   0)"));
}

TEST(Chart, LogarithmicAxisLeavesOutWhatIsNotPositive) {
  Chart chart = swing();
  chart.curves[0].points = {{0, -0.25}, {0.25, 0}, {0.5, 0.01}, {1, 100}};
  const auto has_row = [&](const std::string& row) {
    return chart_commands({chart}).find("\n" + row + "\n") != std::string::npos;
  };
  EXPECT_TRUE(has_row("0 -0.25") && has_row("0.25 0") && has_row("0.5 0.01"));
  EXPECT_THAT(drawn(chart), HasSubstr("20</tspan>")) << "a tic of the linear axis";

  chart.logarithmic_y = true;
  EXPECT_TRUE(!has_row("0 -0.25") && !has_row("0.25 0") && has_row("0.5 0.01"));
  const std::string svg = drawn(chart);
  EXPECT_THAT(svg, Not(HasSubstr("20</tspan>")));
  EXPECT_THAT(svg, HasSubstr(">−2</tspan>")) << "the exponent of 0.01";
}

TEST(Chart, OfAStackHasRoomForAllItsTitles) {
  Chart chart = swing();
  chart.wide = true;
  chart.curves.assign(10, chart.curves[0]);
  for (Curve& curve : chart.curves) curve.title = "robust\\_differentiator";
  const std::string ten = stacked_chart_commands({chart, swing()}, "laws");
  // Three titles of 21 letters beside each other, and 21 px for each row but the first.
  EXPECT_THAT(ten, HasSubstr("set key maxrows 4\n"));
  EXPECT_THAT(ten, HasSubstr("svg size 900,743 "));
  chart.curves.resize(3);
  const std::string three = stacked_chart_commands({chart, swing()}, "laws");
  EXPECT_THAT(three, Not(HasSubstr("set key maxrows 4\n")));
  EXPECT_THAT(three, HasSubstr("svg size 900,680 "));
}

TEST(Chart, LogarithmicFloorLeavesOutTheDips) {
  Chart chart = swing();
  chart.curves[0].points = {{0, 1e-12}};
  for (int k = 1; k < 100; ++k) chart.curves[0].points.push_back({k * 0.01, 3e-3});
  make_logarithmic(chart);
  ASSERT_TRUE(chart.y_range);
  EXPECT_EQ(chart.y_range->first, 1e-3);
  chart = swing();
  chart.curves[0].points = {{0, 0}, {1, -2}};
  make_logarithmic(chart);
  EXPECT_FALSE(chart.y_range);
}

Chart kicked(double kick) {
  Chart chart = swing();
  chart.curves[0].points.clear();
  for (int k = 0; k < 1000; ++k) chart.curves[0].points.push_back({k * 1.0, std::sin(k * 0.1)});
  chart.curves[0].points[3].y = kick;
  cut_kick(chart, "N m");
  return chart;
}

TEST(Chart, LeavesAnAxisWhoseCurveFillsIt) {
  EXPECT_FALSE(kicked(2).y_range);
  Chart empty;
  cut_kick(empty, "N m");
  EXPECT_FALSE(empty.y_range);
}

TEST(Chart, CutsItsAxisAtAKickAndKeepsTheRestWithAMargin) {
  const Chart cut = kicked(-500);
  ASSERT_TRUE(cut.y_range);
  EXPECT_LT(cut.y_range->first, -1);
  EXPECT_GT(cut.y_range->first, -2);
  EXPECT_GT(cut.y_range->second, 1);
  EXPECT_EQ(cut.note, "axis cut: peak 500 N m");
}

TEST(Chart, DrawsBarsWithTheirNames) {
  Chart chart;
  chart.name = "events";
  chart.x_range = {{0, 2}};
  chart.bars = {{"saturated 1", {{0.1, 0.2}, {1, 1}}, "#E69F00"},
                {"no COMMAND", {{0.5, 0.6}}, "#777777"}};
  const std::string svg = drawn(chart);
  EXPECT_THAT(svg, HasSubstr("saturated 1"));
  EXPECT_THAT(svg, HasSubstr("no COMMAND"));
}

TEST(Chart, SurvivesCurvesWithNothingToShow) {
  Chart chart = swing();
  for (study::Point& point : chart.curves[0].points) point.y = NAN;
  EXPECT_NO_THROW(drawn(chart));
  chart.logarithmic_y = true;
  for (study::Point& point : chart.curves[0].points) point.y = -1;
  EXPECT_NO_THROW(drawn(chart));
}

TEST(Chart, StacksChartsInOneFile) {
  const TemporaryDirectory directory;
  const auto svg = directory.path() / "stack.svg";
  draw(stacked_chart_commands({swing(), swing()}, "two_swings & more"), svg);
  const std::string text = logger::read_file(svg);
  EXPECT_THAT(text, HasSubstr("two_swings &amp; more"));
  EXPECT_THAT(text, HasSubstr("viewBox=\"0 0 900 680\""));
}

TEST(Chart, GivesANearlyConstantCurveAnAxisWithShortNumbers) {
  const auto commands = [](double least, double largest) {
    Chart chart;
    chart.curves.resize(1);
    chart.curves[0].points = {{0, least}, {1, largest}};
    return chart_commands({chart});
  };
  EXPECT_THAT(commands(-1.5709, -1.5707), HasSubstr("set yrange [-1.5723709:-1.5692291]"));
  EXPECT_THAT(commands(3, 3), HasSubstr("set yrange [2.997:3.003]"));
  for (const auto& [least, largest] : {std::pair(-1.5, -1.6), {-1e-9, 1e-9}, {0.0, 0.0}}) {
    EXPECT_THAT(commands(least, largest), HasSubstr("set yrange [*:*]"));
  }
}

TEST(Chart, DrawsTwentyEightCurvesThatAreToldApart) {
  std::set<std::string> looks;
  for (std::size_t i = 0; i < 28; ++i) looks.insert(colour_of(i) + dash_of(i));
  EXPECT_EQ(looks.size(), 28U);
}

TEST(Chart, StacksMoreThanThreeInTwoColumnsAboveWideOnes) {
  Chart wide = swing();
  wide.wide = true;
  const std::string commands =
      stacked_chart_commands({swing(), swing(), swing(), swing(), swing(), wide}, "six");
  // Three rows of five, one wide; below the second row a column ends, below the third they all do.
  EXPECT_THAT(commands, HasSubstr(" size 900,1328 ")) << 30 + 4 * 300 + 3 * 24 + 26;
  const auto count = [&](const std::string& what) {
    std::size_t found = 0;
    for (std::size_t at = 0; (at = commands.find(what, at)) != std::string::npos; ++at) ++found;
    return found;
  };
  EXPECT_EQ(count("plot $"), 6U);
  EXPECT_EQ(count("set lmargin at screen 0.615555556\n"), 2U) << "the right column";
  EXPECT_EQ(count("set format x ''"), 2U) << "the first row alone has no times";
  EXPECT_EQ(count("set xlabel 'time [s]'"), 1U);
}

}  // namespace
}  // namespace tachless::report
