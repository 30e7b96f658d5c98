// These tests compare the analysis of a loop in certify, the line before a run, its closing table,
// summary.json and the report. tests/analysis/design/design_test.cpp compares design's analysis.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "certify/certify.h"
#include "cli/run.h"
#include "lyapunov/law_loop.h"
#include "report/report.h"
#include "report/report_sections.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::cli::one_analysis_test {
namespace {

using Json = nlohmann::ordered_json;
using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Case {
  const char* scenario;
  std::vector<std::string> set = {};
};

std::vector<Case> twenty() {
  const std::string soft = "controller.gains.kp=[4000, 1500]";
  const std::string dry = "plant.drive.coulomb_friction_Nm=[20, 2]";
  return {{"flexible_regulation"},
          {"iiwa_flexible"},
          {"iiwa_point_to_point"},
          {"panda"},
          {"paper_flexible"},
          {"paper_rigid"},
          {"paper_rigid_offset"},
          {"practical_flexible"},
          {"practical_rigid"},
          {"regulation"},
          {"ur5e"},
          {"xarm7"},
          {"paper_rigid", {"loop.command_delay=1"}},  // unstable
          {"paper_flexible", {"loop.command_delay=1"}},
          {"practical_rigid", {dry}},
          {"practical_rigid", {soft, dry, "plant.drive.static_friction_Nm=[30, 3]"}},
          {"practical_rigid", {"plant.payload.mass_kg=2", "loop.period_s=2e-3"}},
          {"practical_rigid", {"plant.encoder.resolution_bits=14", "loop.command_delay=2"}},
          {"practical_rigid",
           {"controller.law=loria_ortega_scheduled",
            "controller.gains={w: 100, damping: 0.7, a: 1000, b: 1000}", dry}},
          {"practical_rigid",
           {"controller.law=computed_torque", "controller.gains={kp: 900, kd: 60}", dry}}};
}

class OneAnalysis : public ::testing::TestWithParam<Case> {
 protected:
  /// Returns the plan of the case's run. Both tests of a case need it, and it is made once.
  [[nodiscard]] static const PlannedRun& planned() {
    static std::map<std::string, PlannedRun> made;
    const auto [at, is_new] =
        made.try_emplace(fmt::format("{} {}", GetParam().scenario, fmt::join(GetParam().set, " ")));
    if (is_new) at->second = newly_planned();
    return at->second;
  }
  [[nodiscard]] static PlannedRun newly_planned() {
    RunOptions options;
    options.force = true;
    options.overrides = GetParam().set;
    return plan_runs(options, {fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR,
                                           GetParam().scenario)})[0];
  }
  [[nodiscard]] static Json certified(const scenario::Scenario& scenario) {
    certify::Certificate all;
    all.loop = certify::analyse(scenario, linear::Effort::full);
    return to_json(all)["sampled"];
  }
};

INSTANTIATE_TEST_SUITE_P(Scenarios, OneAnalysis, ::testing::ValuesIn(twenty()),
                         [](const auto& each) {
                           return fmt::format("{}_{}", each.param.scenario, each.index + 1);
                         });

TEST_P(OneAnalysis, IsBehindCertifyTheLineBeforeARunAndItsSummary) {
  const PlannedRun& run = planned();
  const report::RunSummary summary{run.scenario, {}, study::Tracking(run.scenario.num_joints),
                                   {},           {}, run.predicted};
  Json predicted = to_json(summary, robot::joint_labels(*run.scenario.model))["predicted"];
  // The text is the line and, with dry friction, a second one.
  std::string lines = run.remarks[0].line;
  if (run.predicted.rest_error.size() > 0) lines += "; " + run.remarks[1].line;
  EXPECT_EQ(predicted["text"], lines);
  predicted.erase("text");

  Json certified = OneAnalysis::certified(run.scenario);
  EXPECT_EQ(certified.contains("margins"), run.predicted.unstable_q.size() == 0);
  for (const char* more : {"margins", "margin_q", "missed"}) certified.erase(more);
  EXPECT_EQ(predicted, certified);
  // A law with such a gain has that stiffness, with any filters.
  const auto kp = run.scenario.controller.gains.find("kp");
  if (kp == run.scenario.controller.gains.end() ||
      run.scenario.controller.law != "loria_ortega_rigid") {
    return;
  }
  for (int i = 0; i < run.scenario.num_joints; ++i) {
    const double stiffness = certified["stiffness_Nm_per_rad"][i];
    EXPECT_NEAR(stiffness, kp->second[kp->second.size() == 1 ? 0 : i], 1e-5 * stiffness) << i;
  }
}

/// Expects the same certificate of the start in a run and in certify. If a run's quick search
/// leaves it open, certify searches further.
void expect_same_start(const scenario::Scenario& scenario) {
  using namespace certify;
  using namespace linear;
  using namespace lyapunov;
  const auto of_run = certify::certified_run(scenario);
  if (!no_region(analyse(scenario, Effort::quick)).empty()) {
    EXPECT_FALSE(of_run) << "a region under an unstable loop";
    return;
  }
  Certificate all;
  all.stability = stability_certificate(scenario, Effort::full, all.no_stability);
  EXPECT_EQ(all.no_stability, no_certificate(scenario));
  if (!all.stability) {
    EXPECT_FALSE(of_run);
    return;
  }
  const CertifiedStart start = of_run ? of_run->start : CertifiedStart();
  const Json certified = to_json(all)["region"]["start"];
  EXPECT_TRUE(certified["certified"].is_boolean());
  if (start.decided) {
    EXPECT_EQ(to_json(start), certified);
  } else {
    EXPECT_FALSE(all.stability->proved);
    EXPECT_TRUE(to_json(start)["certified"].is_null());
  }
}

TEST_P(OneAnalysis, SaysTheSameOfTheStartInCertifyAndInARun) {
  expect_same_start(planned().scenario);
}

TEST(Start, HasTheSameShareOfTheTorqueLimitsInCertifyAndInARun) {
  const auto with = [](const char* scenario, const std::vector<std::string>& set) {
    SCOPED_TRACE(set[0]);
    expect_same_start(
        scenario::load_scenario(fmt::format("{}/{}.yaml", TACHLESS_SOURCE_DIR, scenario), set));
  };
  for (const char* limits : {"[900, 300]", "[500, 100]"}) {
    with("scenarios/practical_rigid", {fmt::format("plant.drive.torque_limit_Nm={}", limits)});
  }
  with("scenarios/regulation", {"plant.drive.torque_limit_Nm=[900, 300]"});
  with("examples/project/arm", {"plant.initial.position_rad=[0.1, -0.1]"});
  with("scenarios/iiwa_point_to_point",
       {"plant.initial.position_rad=[0.1, 0.4, 0, -1, 0, 0.8, 0]"});
}

/// A run sets it only for a real robot, and only if the user gives no other number.
TEST(MaxMissed, IsWhatTheLoopWasFoundToBear) {
  const auto planned = [](const char* driver, std::vector<std::string> more,
                          const char* law_program = "") {
    RunOptions options;
    options.mode = "realtime";
    options.plant_program = driver;
    options.law_program = law_program;
    options.overrides = std::move(more);
    return plan_runs(options, {TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml"})[0];
  };
  const PlannedRun run = planned("driver", {});
  const certify::Prediction full = certify::analyse(run.scenario, linear::Effort::full);
  ASSERT_LT(full.missed->commands, 20);
  EXPECT_EQ(run.scenario.loop.max_missed, full.missed->commands);
  EXPECT_EQ(run.options.overrides,
            std::vector<std::string>{fmt::format("loop.max_missed={}", full.missed->commands)});
  EXPECT_EQ(planned("driver", {"loop.max_missed=30"}).scenario.loop.max_missed, 30);
  EXPECT_EQ(planned("", {}).scenario.loop.max_missed, 20);
  // A program's law has it too, and the run keeps the law's name.
  const PlannedRun own = planned("driver", {}, TACHLESS_BINARY_DIR "/bin/tachless-own-law");
  EXPECT_EQ(own.scenario.loop.max_missed, full.missed->commands);
  EXPECT_EQ(own.scenario.controller.law_text(), "own_law (external)");
}

/// A law whose stiffness is no gain has F_c/kp = |(w^2 M)^-1| F_c, the largest over the motion.
TEST(RestError, IsThatOfTheStiffnessThatTheLawHas) {
  const Case scheduled = twenty()[18];
  const scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml", scheduled.set);
  const auto found = certify::analyse(scenario, linear::Effort::quick);
  // M of the elbow is 0.62 kg m2 in every posture.
  EXPECT_NEAR(found.stiffness[1], 1e4 * 0.62, 1);
  // M = [[9.79, 1.27], [1.27, 0.62]] at q = 0, in three digits; F_c = (20, 2).
  EXPECT_NEAR(found.rest_error[1], (1.27 * 20 + 9.79 * 2) / (1e4 * 4.455), 5e-6);
  EXPECT_THAT(friction_text(found), HasSubstr("F_c/kp = ["));
}

TEST(Page, HasTheLineOfThePredictionAndTheCertifiedBound) {
  for (const std::string name :
       {"practical_rigid", "paper_rigid_offset", "paper_flexible", "ur5e"}) {
    SCOPED_TRACE(name);
    const scenario::Scenario scenario = support::shortened(name + ".yaml", "0.1");
    const TemporaryDirectory directory;
    const auto log = directory.path() / "lcmlog";
    logger::write_file(log, logger::log_of(support::in_process_log(scenario)));
    std::vector<report::RecordedRun> runs;
    runs.push_back(report::read_recorded_run(log, {}, lyapunov::certified_run));
    const auto predicted = certify::analyse(scenario, linear::Effort::quick);
    runs[0].outcome = {{"predicted", to_json(predicted)}};
    const auto certified = lyapunov::certified_run(scenario);
    ASSERT_TRUE(certified && runs[0].certified);
    EXPECT_EQ(certify::to_json(runs[0].certified->start), certify::to_json(certified->start));
    label(runs);
    const report::Overlay all(runs);
    const std::string page = report_page(all, report_sections(all));
    EXPECT_THAT(page, HasSubstr(text(predicted)));
    // Within 0.1 s the reference of ur5e has not begun to move.
    EXPECT_THAT(page, HasSubstr(certified->rate == 0
                                    ? "V does not rise"
                                    : fmt::format("V(0) exp(−{:.3g} t)", certified->rate)));
  }
}

/// The law has weights of its own. If they hold the start, the page says that V does not rise. It
/// names neither a constant reference nor a rate.
TEST(Page, SaysOfALawWithAnIntegralWhatIsCertifiedOfIt) {
  const scenario::Scenario scenario = support::shortened(
      "practical_rigid.yaml", "0.1",
      {"controller.law=loria_ortega_integral", "controller.gains.ki=[10000, 600]",
       "controller.gains.eps_1=28", "controller.gains.eps_2=0.14"});
  const TemporaryDirectory directory;
  const auto log = directory.path() / "lcmlog";
  logger::write_file(log, logger::log_of(support::in_process_log(scenario)));
  std::vector<report::RecordedRun> runs;
  runs.push_back(report::read_recorded_run(log, {}, lyapunov::certified_run));
  ASSERT_TRUE(runs[0].certified);
  ASSERT_EQ(runs[0].certified->rate, 0);
  label(runs);
  const report::Overlay all(runs);
  EXPECT_THAT(report_page(all, report_sections(all)),
              HasSubstr(fmt::format("the matrix condition certifies that V does not rise from this "
                                    "start in continuous time (proved), and stays below {:.3g} J.",
                                    runs[0].certified->level)));
}

}  // namespace
}  // namespace tachless::cli::one_analysis_test
