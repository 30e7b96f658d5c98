#include "report/chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "report/gnuplot.h"
#include "tests/support/damaged_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using ::testing::HasSubstr;

std::string drawn(const Chart& chart) {
  const TemporaryDirectory directory;
  draw(chart_commands({chart}, directory.path()), directory.path() / "script");
  return logger::read_file(directory.path() / (chart.name + ".svg"));
}

Chart swing() {
  Chart chart;
  chart.name = "swing";
  chart.y_label = "{/:Italic q}_{1}  [rad]";
  chart.x_range = {{0, 1}};
  Curve curve{"link", {}, "#0072B2", 1.4, "", CurveStyle::line};
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
  chart.logarithmic_y = true;
  EXPECT_EQ(logarithmic_floor({}), std::nullopt);
  EXPECT_THAT(drawn(chart), HasSubstr("−")) << "powers of ten below one";
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
  for (Point& point : chart.curves[0].points) point.y = NAN;
  EXPECT_NO_THROW(drawn(chart));
  chart.logarithmic_y = true;
  for (Point& point : chart.curves[0].points) point.y = -1;
  EXPECT_NO_THROW(drawn(chart));
}

TEST(Chart, StacksChartsInOneFile) {
  const TemporaryDirectory directory;
  const auto svg = directory.path() / "stack.svg";
  draw(stacked_chart_commands({swing(), swing()}, "two_swings & more", svg), svg);
  const std::string text = logger::read_file(svg);
  EXPECT_THAT(text, HasSubstr("two_swings &amp; more"));
  EXPECT_THAT(text, HasSubstr("viewBox=\"0 0 900 670\""));
}

}  // namespace
}  // namespace tachless::report
