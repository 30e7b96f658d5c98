#include "report/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <regex>
#include <set>

#include "diagnostics/failure.h"
#include "report/report_charts.h"
#include "report/report_page.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using logger::Recorded;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Report : public ::testing::Test {
 protected:
  std::filesystem::path write_log(const std::string& directory,
                                  const std::vector<Recorded>& messages) {
    const auto path = directory_.path() / directory / "lcmlog";
    std::filesystem::create_directories(path.parent_path());
    logger::write_file(path, logger::log_of(messages));
    return path;
  }
  RecordedRun run(const std::string& directory, const std::vector<Recorded>& messages) {
    return read_recorded_run(write_log(directory, messages));
  }
  static std::string page_of(std::vector<RecordedRun> runs) {
    label(runs);
    return report_page(runs, report_sections(runs), {});
  }

  TemporaryDirectory directory_;
};

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; ++at) ++found;
  return found;
}

TEST_F(Report, HasEveryPartAndRefersToNothingOutside) {
  const auto log =
      write_log("a", support::in_process_log(support::shortened("practical_rigid.yaml", "0.5")));
  std::ofstream(log.parent_path() / "summary.json") << R"({"run_id": 7, "wall_s": 0.25,
    "real_time_factor": 2, "fault": null, "round_trip_us": {"p50": 30, "p99": 60, "p999": 90,
    "max": 100, "histogram": [[30, 400], [34, 99], [90, 1]]},
    "command_age_us": {"histogram": [[20, 500]]},
    "wake_up_jitter_us": {"histogram": [[1, 300], [2, 200]]}})";
  std::vector<RecordedRun> runs;
  runs.push_back(read_recorded_run(log));
  const auto html = directory_.path() / "report.html";
  write_report(runs, html);
  const std::string page = logger::read_file(html);
  for (const std::string figure :
       {"tracking-1", "tracking-2", "error-1", "error-2", "torque-1", "torque-2", "controller-1",
        "controller-2", "lyapunov-v", "round-trip", "command-age", "wake-up"}) {
    EXPECT_THAT(page, HasSubstr("<figure id=\"" + figure + "\"")) << figure;
  }
  EXPECT_EQ(count(page, "<figure"), 12U);
  EXPECT_EQ(count(page, "role=\"img\""), 13U) << "the wide one also narrow";
  EXPECT_THAT(page, Not(HasSubstr("not drawn")));
  // Nothing to fetch, nothing to execute.
  EXPECT_THAT(page, AllOf(Not(HasSubstr("://")), Not(HasSubstr("<script")),
                          Not(HasSubstr("@import")), Not(HasSubstr("src="))));
  EXPECT_THAT(page, AllOf(HasSubstr("practical_rigid"), HasSubstr("loria_ortega_rigid"),
                          HasSubstr("kp = [40000, 2400]"), HasSubstr("20 bit per revolution")));
  EXPECT_THAT(page, HasSubstr("No torque saturated, no command was missed"));
  // An id occurs once, whatever gnuplot calls its parts.
  static const std::regex id(" id=['\"]([^'\"]+)['\"]");
  std::set<std::string> ids;
  for (std::sregex_iterator match(page.begin(), page.end(), id), end; match != end; ++match) {
    EXPECT_TRUE(ids.insert((*match)[1]).second) << (*match)[1];
  }
}

TEST_F(Report, NamesTheLawsSignals) {
  const auto page = [&](const std::string& law, std::vector<std::string> overrides) {
    overrides.push_back("controller.law=" + law);
    return page_of({run(law, support::in_process_log(
                                 support::shortened("practical_rigid.yaml", "0.01", overrides)))});
  };
  EXPECT_THAT(page("loria_ortega_rigid", {}),
              AllOf(HasSubstr("<i>nu</i> [rad/s]"), HasSubstr("in place of the velocity error")));
  EXPECT_THAT(
      page("slotine_li", {"controller.gains={lambda: 20, ks: [100, 10]}"}),
      AllOf(HasSubstr("<i>edot</i> [rad/s]: the velocity error"), Not(HasSubstr("in place of"))));
}

TEST_F(Report, GivesTheRateThatTheLinearisedLoopHas) {
  const RecordedRun recorded =
      run("a", support::in_process_log(support::shortened("practical_rigid.yaml", "1.0")));
  // The slowest mode of the linearised loop decays with 37.0 1/s; joints and staircase smear it.
  for (const auto& decay : recorded.decay) {
    ASSERT_TRUE(decay);
    EXPECT_NEAR(decay->rate_per_s, 37.0, 2.0);
  }
  ASSERT_TRUE(recorded.lyapunov_decay);
  EXPECT_NEAR(recorded.lyapunov_decay->rate_per_s, 2 * 37.0, 4.0);  // quadratic in the state
}

TEST_F(Report, ShowsWhatWentWrong) {
  auto messages = support::in_process_log(
      support::shortened("practical_rigid.yaml", "0.2", {"plant.drive.torque_limit_Nm=[200, 20]"}));
  messages.erase(messages.begin() + 1 + 6 * 100 + 3);  // COMMAND of tick 100
  logger::RecordedRun faulty;
  faulty.info.robot = "ARM";
  faulty.run = 7;
  messages.push_back(logger::fault_message(faulty, "<encoder> & cable lost"));
  std::string bytes = logger::log_of(messages);
  bytes.insert(bytes.size() / 2, "garbage");
  const auto path = directory_.path() / "lcmlog";
  logger::write_file(path, bytes);
  const std::string page = page_of({read_recorded_run(path)});
  EXPECT_THAT(page, HasSubstr("No ARM_COMMAND in 1 tick"));
  EXPECT_THAT(page, HasSubstr("Torque of joint 1 (shoulder) saturated"));
  EXPECT_THAT(page, HasSubstr("Fault of the controller at tick 17: &lt;encoder&gt; &amp; cable"));
  EXPECT_THAT(page, HasSubstr("The log is damaged"));
  EXPECT_THAT(page, Not(HasSubstr("<encoder>")));
  EXPECT_THAT(page, HasSubstr("<figure id=\"events-1\" class=\"wide\">"));
}

TEST_F(Report, OverlaysRunsWithALegend) {
  const auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  const auto flexible =
      support::in_process_log(support::shortened("practical_flexible.yaml", "0.1"));
  const std::string page =
      page_of({run("first", messages), run("second", messages), run("third", flexible)});
  EXPECT_THAT(page, AllOf(HasSubstr("</svg>first"), HasSubstr("</svg>second"),
                          HasSubstr("</svg>third"), HasSubstr("class=\"legend\"")));
  EXPECT_EQ(count(page, "<figure id=\"tracking-1\""), 1U);
}

TEST_F(Report, LabelsRunsByWhatTellsThemApart) {
  std::vector<RecordedRun> runs;
  const auto messages = support::in_process_log(support::shortened("regulation.yaml", "0.01"));
  runs.push_back(run("a", messages));
  label(runs);
  EXPECT_EQ(runs[0].label, "regulation");
  runs.push_back(
      run("b", support::in_process_log(support::shortened("practical_rigid.yaml", "0.01"))));
  label(runs);
  EXPECT_EQ(runs[1].label, "practical_rigid");
  runs.pop_back();
  runs.push_back(run("b", support::in_process_log(support::shortened(
                              "regulation.yaml", "0.01", {"controller.law=kelly_regulation"}))));
  label(runs);
  EXPECT_EQ(runs[1].label, "kelly_regulation");
  runs.push_back(run("c", messages));
  label(runs);
  EXPECT_EQ(runs[2].label, "c");
}

TEST_F(Report, DoesNotTakeAnotherRunsSummary) {
  const auto log =
      write_log("a", support::in_process_log(support::shortened("regulation.yaml", "0.01")));
  for (const char* text : {R"({"run_id": 8, "wall_s": 1})", "[]", "{", "", R"({"run_id": "7"})"}) {
    std::ofstream(log.parent_path() / "summary.json") << text;
    EXPECT_TRUE(read_recorded_run(log).outcome.is_null()) << text;
  }
}

TEST_F(Report, SaysWhereItCannotWrite) {
  std::vector<RecordedRun> runs;
  runs.push_back(run("a", support::in_process_log(support::shortened("regulation.yaml", "0.01"))));
  try {
    write_report(runs, "/nowhere/report.html");
    FAIL();
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("/nowhere/report.html"));
  }
}

TEST(Stretches, JoinNeighboursAndCountWhatTheyDoNotList) {
  Stretches stretches;
  for (const std::int64_t tick : {3, 4, 5, 9}) stretches.add(tick);
  ASSERT_EQ(stretches.listed().size(), 2U);
  EXPECT_EQ(stretches.listed()[0].first, 3);
  EXPECT_EQ(stretches.listed()[0].last, 5);
  for (std::int64_t tick = 20; tick < 20 + 2 * 600; tick += 2) stretches.add(tick);
  EXPECT_EQ(stretches.ticks(), 604);
  EXPECT_EQ(stretches.listed().size(), Stretches::max_listed);
  EXPECT_TRUE(stretches.cut());
}

}  // namespace
}  // namespace tachless::report
