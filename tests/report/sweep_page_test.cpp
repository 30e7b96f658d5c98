#include "report/sweep_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <regex>

#include "diagnostics/failure.h"
#include "study/measures.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using study::SweepPlan;
using study::SweepRow;
using testing::HasSubstr;
using testing::Not;

SweepPlan plan_of(const std::vector<std::string>& axes, const std::string& file = "study_encoder") {
  const experiment::Scenario scenario =
      experiment::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/" + file + ".yaml");
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

/// Rows as if run: every measure is 1 + the case's number.
std::vector<SweepRow> rows_of(const SweepPlan& plan) {
  std::vector<SweepRow> rows;
  for (std::int64_t i = 0; i < plan.num_cases(); ++i) {
    rows.push_back({"", plan.at(i), "converged",
                    std::vector<double>(study::measure_columns().size(), 1.0 + i), ""});
  }
  return rows;
}

std::size_t count(const std::string& text, const std::string& words) {
  const std::regex pattern(words);
  return static_cast<std::size_t>(
      std::distance(std::sregex_iterator(text.begin(), text.end(), pattern), {}));
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
    } catch (const diagnostics::Failure& failure) {
      return failure.what();
    }
    return "drawn";
  }

 private:
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
  const std::string commands = sweep_curves(plan, rows_of(plan), {1, 2, 4});
  EXPECT_EQ(count(commands, "\nplot "), 6U);
  EXPECT_EQ(count(commands, "with lines"), 12U);
  // The list's first value and its second, of the first law and of the second.
  EXPECT_THAT(commands, HasSubstr("$d0 << END\n12 1\n14 3\n16 5\n"));
  EXPECT_THAT(commands, HasSubstr("$d0 << END\n12 2\n14 4\n16 6\n"));
  EXPECT_THAT(commands, HasSubstr("$d4 << END\n12 8\n14 10\n16 12\n"));
  EXPECT_THAT(commands, Not(HasSubstr("limit cycle, saturated")));
}

TEST(SweepCurves, MarkRunsWithoutAValueAtTheUpperEdge) {
  const SweepPlan plan = plan_of({bits});
  std::vector<SweepRow> rows = rows_of(plan);
  rows[1].outcome = "limit_cycle";
  rows[2].outcome = "stopped";
  rows[2].measures.assign(rows[2].measures.size(), 1e9);  // no value to scale an axis by
  const std::string commands = sweep_curves(plan, rows, {1});
  EXPECT_THAT(commands, HasSubstr("$d0 << END\n12 1\n14 2\nnan"));
  EXPECT_THAT(commands, HasSubstr("$d2 << END\n14 2\nnan"));
  std::smatch broken, range;
  ASSERT_TRUE(std::regex_search(commands, broken, std::regex("\\$d3 << END\n16 (.*)\n")));
  ASSERT_TRUE(std::regex_search(commands, range, std::regex("set yrange \\[0:(.*)\\]")));
  EXPECT_GT(std::stod(broken[1]), 2);
  EXPECT_LT(std::stod(broken[1]), std::stod(range[1]));
  EXPECT_LT(std::stod(range[1]), 10);
}

TEST_F(SweepPage, DrawsCurvesOfSeveralMeasures) {
  const SweepPlan plan = plan_of({bits});
  const std::string svg = map(plan, rows_of(plan), "velocity_error,energy");
  EXPECT_THAT(svg, HasSubstr("velocity_error [rad/s; m/s]"));
  EXPECT_THAT(svg, HasSubstr("energy [J]"));
}

TEST_F(SweepPage, RefusesWhatItCannotShow) {
  const SweepPlan curves = plan_of({bits});
  const SweepPlan map = plan_of({bits, "reference.sinusoid.frequency_hz=1:5:2"});
  EXPECT_THAT(refusal(map, "energy,rms_error"), HasSubstr("a map shows one measure"));
  EXPECT_THAT(refusal(map, "energy,"), HasSubstr("no measure; allowed: outcome, certified, "));
  EXPECT_THAT(refusal(curves, "certified"), HasSubstr("needs a map"));
  EXPECT_EQ(refusal(map, "energy"), "drawn");
}

TEST_F(SweepPage, MarksTheStartsThatAreCertified) {
  const auto dots = [&](const std::string& gains) {
    const SweepPlan plan = plan_of(
        {"controller.gains.b=" + gains, "plant.initial.position_rad=0.1:1:2"}, "study_attraction");
    return count(map(plan, rows_of(plan), "certified"), "<use ");
  };
  const std::size_t none = dots("1:2:2"), all = dots("100:200:2");
  EXPECT_GE(all, none + 4);
}

}  // namespace
}  // namespace tachless::report
