// Charts as data, and their SVG.

#include "report/figure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <regex>
#include <set>

#include "report/axis.h"
#include "tests/support/damaged_log.h"
#include "tests/support/temporary_directory.h"
#include "tests/tools/report/count.h"

namespace tachless::report {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

std::string drawn(const Figure& figure) { return inline_svg(figure, "caption").markup(); }

Chart of(const std::vector<double>& values) {
  Chart chart;
  chart.y_label = of_joint("q", 0, "shoulder", "rad");
  chart.curves = {{words("link"), {}, "#0072B2"}};
  for (std::size_t k = 0; k < values.size(); ++k) {
    chart.curves[0].points.push_back({static_cast<double>(k), values[k]});
  }
  return chart;
}

TEST(Figure, DrawsCurvesAxesKeyAndNote) {
  Chart chart = of({0, 1, -1});
  chart.note = "axis cut";
  chart.curves[0].dash = {6, 4};
  chart.heading = "Joint 1";
  const std::string svg = drawn({"a run", {chart}});
  EXPECT_THAT(svg, AllOf(HasSubstr(">a run<"), HasSubstr(">link<"), HasSubstr(">axis cut<"),
                         HasSubstr(">Joint 1<"), HasSubstr("time [s]"), HasSubstr("−1.0")));
  EXPECT_THAT(svg, HasSubstr("<tspan font-style=\"italic\">q</tspan><tspan dy=\"4\" "
                             "font-size=\"10\">1</tspan><tspan dy=\"-4\"><tspan dx=\"4\">shoulder "
                             "[rad]</tspan></tspan>"));
  EXPECT_THAT(svg, HasSubstr("stroke=\"#0072B2\" stroke-width=\"1.4\" stroke-linejoin=\"round\" "
                             "stroke-linecap=\"butt\" stroke-dasharray=\"6,4\""));
}

TEST(Figure, EscapesEveryText) {
  const std::string evil = "a\"'<script>alert(1)</script>]]>&\\\n!touch x\n#\x01\xff";
  Chart chart = of({0, 1});
  chart.heading = chart.note = evil;
  chart.y_label = {evil, evil, evil, evil, true};
  chart.x_label = words(evil, evil);
  chart.curves[0].label = {evil, evil, evil, evil};
  chart.scale = {words(evil), 0, 1};
  const std::string svg = inline_svg({evil, {chart}}, evil).markup();
  EXPECT_THAT(svg, AllOf(Not(HasSubstr("<script")), Not(HasSubstr("]]>")), Not(HasSubstr("\x01")),
                         Not(HasSubstr("\xff"))));
  // The SVG has this program's elements only, and every attribute is quoted.
  static const std::regex element("<(/?[a-z]+)((?: [a-z0-9A-Z-]+=\"[^\"<>]*\")*)(/?)>");
  const std::string rest = std::regex_replace(svg, element, "");
  EXPECT_THAT(rest, AllOf(Not(HasSubstr("<")), Not(HasSubstr(">"))));
  EXPECT_GE(count(svg, "&lt;script&gt;"), 12U);
}

/// Expects that pixels and ticks of both axes are numbers for any values.
void expect_sensible(const Chart& chart) {
  const std::string svg = drawn({"", {chart}});
  EXPECT_THAT(svg, AllOf(Not(HasSubstr("nan")), Not(HasSubstr("inf")), Not(HasSubstr("e+"))));
  for (const bool ordinate : {false, true}) {
    const Axis axis(chart, ordinate, 300);
    EXPECT_TRUE(std::isfinite(axis.low) && axis.low < axis.high) << axis.low << " " << axis.high;
    EXPECT_GE(axis.ticks.size(), 1U);
    EXPECT_LE(axis.ticks.size(), 12U);
    for (const Tick& tick : axis.ticks) {
      EXPECT_TRUE(axis.at(tick.value) > -1e-6 && axis.at(tick.value) < 300 + 1e-6);
    }
  }
}

// A decaying signal ends in denormal numbers, and a joint that never moves has one value. gnuplot
// refused to draw such ranges, and a run without a fault ended with code 2.
TEST(Figure, DrawsWhateverTheValuesAre) {
  constexpr double denormal = std::numeric_limits<double>::denorm_min();
  constexpr double inf = INFINITY;
  const std::vector<std::vector<double>> cases = {{},
                                                  {0},
                                                  {0, 0, 0},
                                                  {-1.25, -1.25},
                                                  {denormal, denormal, 0},
                                                  {1e-310, -1e-310},
                                                  {1e-300, 2e-300},
                                                  {1, std::nextafter(1, 2)},
                                                  {1e308, -1e308},
                                                  {inf, -inf, NAN},
                                                  {NAN, 1, inf, 2},
                                                  {1e-12, 1e12},
                                                  {-1, -2},
                                                  {1.5707, 1.5709}};
  for (const std::vector<double>& values : cases) {
    SCOPED_TRACE(::testing::PrintToString(values));
    Chart chart = of(values);
    expect_sensible(chart);
    make_logarithmic(chart);
    expect_sensible(chart);
    chart = of(values);
    cut_kick(chart, "N m");
    expect_sensible(chart);
    chart.logarithmic_x = true;
    chart.x_range = {{0, 0}};
    expect_sensible(chart);
  }
}

TEST(Figure, LogarithmicAxisHasDecadesAndLeavesOutWhatIsNotPositive) {
  Chart chart = of({-1, 0, 1e-3, 1});
  chart.x_range = {{0, 3}};
  chart.logarithmic_y = true;
  const Axis axis(chart, true, 300);
  ASSERT_EQ(axis.ticks.size(), 4U);
  EXPECT_NEAR(axis.ticks[0].value, 1e-3, 1e-15);
  EXPECT_THAT(axis.ticks[0].text.markup(), HasSubstr(">−3</tspan>"));
  EXPECT_NEAR(axis.at(1e-3) - axis.at(1e-2), axis.at(1e-1) - axis.at(1), 1e-9);
  const std::string svg = drawn({"", {chart}});
  const std::string path = svg.substr(svg.find("<path d=\"M") + 10, 5);
  EXPECT_TRUE(path.starts_with("530.7")) << path << ": two thirds of 796 px";
}

TEST(Figure, NumbersOfTicksAreShort) {
  const auto first = [](const std::vector<double>& values) {
    return Axis(of(values), true, 150).ticks.front().text.markup();
  };
  EXPECT_EQ(first({0, 1}), "0.0");
  EXPECT_EQ(first({0, 50}), "0");
  EXPECT_EQ(first({-0.03, 0.03}), "−0.02");
  const Axis small(of({0, 3e-6}), true, 150);
  EXPECT_EQ(small.exponent, -6);
  EXPECT_EQ(small.ticks.back().text.markup(), "3");
}

TEST(Figure, StandsInRowsAndColumns) {
  Chart wide = of({0, 1});
  wide.wide = true;
  const Chart narrow = of({0, 1});
  const std::string six = drawn({"six", {narrow, narrow, narrow, narrow, narrow, wide}, 2});
  EXPECT_EQ(count(six, "overflow=\"hidden\""), 6U);
  // Columns share the time axis at their foot, so it stands below the fourth, the fifth and the
  // wide chart.
  EXPECT_EQ(count(six, "time [s]"), 4U) << "below the second row, the third and the last";
  Figure shared{"", {narrow, narrow}, 2, 900, true};
  EXPECT_EQ(count(drawn(shared), ">link<"), 1U);
  shared.one_key = false;
  EXPECT_EQ(count(drawn(shared), ">link<"), 2U);
}

TEST(Figure, DrawsMapsWithTheirColours) {
  const ColourScale scale{words("energy", "J"), 1, 100, true};
  EXPECT_EQ(scale.colour(1), "#2166AC");
  EXPECT_EQ(scale.colour(10), "#F7F7F7");
  EXPECT_EQ(scale.colour(1e9), "#B2182B");
  EXPECT_EQ(ColourScale({{}, 2, 2}).colour(2), "#F7F7F7");
  Chart chart;
  chart.cells = {{0, 1, 0, 1, scale.colour(1)}, {1, 1, 0.5, 0.5, "#123456"}};
  chart.scale = scale;
  const std::string svg = drawn({"", {chart}});
  EXPECT_THAT(svg, AllOf(HasSubstr("fill=\"#2166AC\""), HasSubstr("energy [J]"),
                         HasSubstr("r=\"2.5\" fill=\"#123456\"")));
}

TEST(Figure, IsWrittenAsAFileUnderAnyName) {
  const TemporaryDirectory directory;
  const auto file = directory.path() / "a\n!touch canary\n#'\".svg";
  write_figure({"title", {of({0, 1})}}, file, "remedy");
  EXPECT_THAT(logger::read_file(file),
              AllOf(::testing::StartsWith("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg "
                                          "xmlns=\"http://www.w3.org/2000/svg\" "),
                    ::testing::EndsWith("</svg>\n")));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(directory.path()), {}), 1);
}

TEST(Chart, LogarithmicFloorLeavesOutTheDips) {
  Chart chart = of({1e-12});
  for (int k = 1; k < 100; ++k) chart.curves[0].points.push_back({k * 1.0, 3e-3});
  make_logarithmic(chart);
  ASSERT_TRUE(chart.y_range);
  EXPECT_EQ(chart.y_range->first, 1e-3);
  chart = of({0, -2, 1e-310});
  make_logarithmic(chart);
  EXPECT_FALSE(chart.y_range);
  EXPECT_FALSE(has_something(chart));
}

Chart kicked(double kick) {
  std::vector<double> values(1000);
  for (std::size_t k = 0; k < 1000; ++k) values[k] = std::sin(static_cast<double>(k) * 0.1);
  values[3] = kick;
  Chart chart = of(values);
  cut_kick(chart, "N m");
  return chart;
}

TEST(Chart, CutsItsAxisAtAKickAndKeepsTheRestWithAMargin) {
  EXPECT_FALSE(kicked(2).y_range) << "a curve that fills its axis";
  const Chart cut = kicked(-500);
  ASSERT_TRUE(cut.y_range);
  EXPECT_LT(cut.y_range->first, -1);
  EXPECT_GT(cut.y_range->first, -2);
  EXPECT_GT(cut.y_range->second, 1);
  EXPECT_EQ(cut.note, "axis cut: peak 500 N m");
}

TEST(Chart, DrawsTwentyEightCurvesThatLookDifferent) {
  std::set<std::string> looks;
  for (std::size_t i = 0; i < 28; ++i) {
    looks.insert(colour_of(i) + ::testing::PrintToString(dash_of(i)));
  }
  EXPECT_EQ(looks.size(), 28U);
}

TEST(Chart, LabelsAreMarkupOfPlainText) {
  EXPECT_EQ(html_of({"e", "2", "elbow", "rad", true}).markup(),
            "|<i>e</i><sub>2</sub>| elbow [rad]");
  EXPECT_EQ(html_of(words("", "N m")).markup(), "[N m]");
  EXPECT_EQ(html_of(words("<b>")).markup(), "&lt;b&gt;");
  EXPECT_EQ(of_joint("q", 0, "a_very_long_name_of_a_joint").text, "…g_name_of_a_joint");
}

}  // namespace
}  // namespace tachless::report
