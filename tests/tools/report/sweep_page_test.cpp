#include "report/sweep_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "base/failure.h"
#include "study/measures.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using study::SweepPlan;
using study::SweepRow;
using testing::HasSubstr;

SweepPlan plan_of(const std::vector<std::string>& axes, const std::string& file = "study_encoder") {
  const scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/" + file + ".yaml");
  SweepPlan plan;
  plan.name = scenario.name;
  plan.source = file + ".yaml";
  plan.text = scenario.text;
  plan.urdf = scenario.robot.urdf_text;
  plan.num_joints = scenario.num_joints;
  plan.laws = {{scenario.controller.law, {}}};
  for (const std::string& axis : axes) plan.axes.push_back(study::parse_axis(axis, false));
  return plan;
}

/// Returns rows as if run: every measure is 1 plus the case's number.
std::vector<SweepRow> rows_of(const SweepPlan& plan) {
  std::vector<SweepRow> rows;
  for (std::int64_t i = 0; i < plan.num_cases(); ++i) {
    rows.push_back(
        {"", plan.at(i), study::Outcome::converged,
         std::vector<double>(study::measure_columns(plan.is_comparison()).size(), 1.0 + i), ""});
  }
  return rows;
}

class SweepPage : public testing::Test {
 protected:
  std::string map(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                  const std::string& colour) {
    write_sweep_page(plan, rows, colour, directory_.path());
    std::ifstream file(directory_ / "map.svg");
    return {std::istreambuf_iterator<char>(file), {}};
  }
  std::string refusal(const SweepPlan& plan, const std::string& colour) {
    try {
      map(plan, rows_of(plan), colour);
    } catch (const base::Failure& failure) {
      return failure.what();
    }
    return "drawn";
  }

  TemporaryDirectory directory_;
};

constexpr const char* bits = "plant.encoder.resolution_bits=12:16:3";

TEST(SweepCurves, AreOfOneAxisAndOfLists) {
  EXPECT_TRUE(shown_by_curves(plan_of({bits})));
  EXPECT_TRUE(shown_by_curves(plan_of({bits, "reference.sinusoid.frequency_hz=1,5"})));
  EXPECT_FALSE(shown_by_curves(plan_of({bits, "reference.sinusoid.frequency_hz=1:5:2"})));
  EXPECT_FALSE(shown_by_curves(plan_of({bits, "reference.sinusoid.frequency_hz=1,2,3,4,5"})));
  SweepPlan drawn = plan_of({bits});
  drawn.drawn = 3;
  EXPECT_FALSE(shown_by_curves(drawn));
}

TEST(SweepCurves, HaveADiagramPerMeasureAndValueOfTheLists) {
  SweepPlan plan = plan_of({bits, "reference.sinusoid.frequency_hz=1,5"});
  plan.laws.push_back({"wen_bayard", {}});
  const Figure figure = curves_figure(plan, rows_of(plan), {1, 2, 4});
  ASSERT_EQ(figure.charts.size(), 6U);
  EXPECT_EQ(figure.columns, 2U);
  const auto line = [&](std::size_t chart, const std::string& law) {
    for (const Curve& curve : figure.charts[chart].curves) {
      if (curve.label.text == law) return curve.points;
    }
    return std::vector<study::Point>();
  };
  using Points = std::vector<study::Point>;
  // The lines for the list's first and second value, of the first law and of the second.
  EXPECT_EQ(line(0, plan.laws[0].name), (Points{{12, 1}, {14, 3}, {16, 5}}));
  EXPECT_EQ(line(1, plan.laws[0].name), (Points{{12, 2}, {14, 4}, {16, 6}}));
  EXPECT_EQ(line(1, "wen_bayard"), (Points{{12, 8}, {14, 10}, {16, 12}}));
  EXPECT_EQ(figure.charts[0].curves.size(), 4U) << "of each law a line and its points";
}

TEST(SweepCurves, MarkRunsWithoutAValueAtTheUpperEdge) {
  const SweepPlan plan = plan_of({bits});
  std::vector<SweepRow> rows = rows_of(plan);
  rows[1].outcome = study::Outcome::oscillates;
  rows[2].outcome = study::Outcome::stopped;
  rows[2].measures.assign(rows[2].measures.size(), 1e9);  // no value to scale an axis by
  const Chart chart = curves_figure(plan, rows, {1}).charts.at(0);
  using Points = std::vector<study::Point>;
  EXPECT_EQ(chart.curves[0].points, (Points{{12, 1}, {14, 2}}));
  const auto marked = [&](Marker marker) {
    const auto found = std::ranges::find_if(chart.curves, [&](const Curve& curve) {
      return curve.marker == marker && !curve.points.empty();
    });
    return found == chart.curves.end() ? Points() : found->points;
  };
  EXPECT_EQ(marked(Marker::ring), (Points{{14, 2}}));
  ASSERT_EQ(marked(Marker::cross).size(), 1U);
  const study::Point broken = marked(Marker::cross)[0];
  EXPECT_EQ(broken.x, 16);
  EXPECT_GT(broken.y, 2);
  EXPECT_LT(broken.y, chart.y_range->second);
  EXPECT_LT(chart.y_range->second, 10);
  EXPECT_EQ(chart.curves.back().label.text, "diverging, stopped");
}

TEST_F(SweepPage, DrawsCurvesOfSeveralMeasures) {
  const SweepPlan plan = plan_of({bits});
  const std::string svg = map(plan, rows_of(plan), "velocity_error,energy");
  EXPECT_THAT(svg, HasSubstr("velocity_error [rad/s]"));
  EXPECT_THAT(svg, HasSubstr("energy [J]"));
}

TEST_F(SweepPage, RefusesWhatItCannotShow) {
  const SweepPlan map = plan_of({bits, "reference.sinusoid.frequency_hz=1:5:2"});
  EXPECT_THAT(refusal(map, "energy,rms_error"), HasSubstr("a map shows one measure"));
  EXPECT_THAT(refusal(map, "energy,"), HasSubstr("no measure; allowed: outcome, peak_error"));
  EXPECT_EQ(refusal(map, "energy"), "drawn");
}

TEST(SweepMap, OfAnAxisWithOneValueHasCellsAroundIt) {
  SweepPlan plan = plan_of({bits, "plant.initial.position_rad[0]=-1:-1:1"});
  const auto expect_around = [&](double value) {
    const Chart chart = maps_figure(plan, rows_of(plan), {}).charts.at(0);
    ASSERT_TRUE(chart.y_range);
    EXPECT_LT(chart.y_range->first, value);
    EXPECT_GT(chart.y_range->second, value);
    for (const Cell& cell : chart.cells) EXPECT_LT(cell.bottom, cell.top);
  };
  expect_around(-1);
  plan.axes[1] = study::parse_axis("plant.payload.mass_kg=0.01:0.01:1:log", false);
  expect_around(0.01);
  EXPECT_GT(maps_figure(plan, rows_of(plan), {}).charts.at(0).y_range->first, 0) << "a logarithm";
}

TEST_F(SweepPage, OfAComparisonIsATable) {
  SweepPlan plan = plan_of({});
  plan.laws.push_back({"slotine_li", {"controller.law=slotine_li"}});
  std::vector<SweepRow> rows = rows_of(plan);
  rows[1].measures = std::vector<double>(study::measure_columns(true).size(), 0.125);
  rows[1].measures.back() = NAN;
  EXPECT_EQ(map(plan, rows, "outcome"), "");
  std::ifstream file(directory_ / "index.html");
  const std::string page(std::istreambuf_iterator<char>(file), {});
  EXPECT_THAT(page,
              HasSubstr("<th>slotine_li</th><td>converged</td><td class=\"number\">0.125</td>"));
  EXPECT_THAT(page, HasSubstr("<td class=\"number\">-</td></tr>"));
  EXPECT_THAT(page, HasSubstr("slotine_li: <code>controller.law=slotine_li</code>"));
}

}  // namespace
}  // namespace tachless::report
