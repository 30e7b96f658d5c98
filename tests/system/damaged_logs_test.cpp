// Replay and report on damaged logs: nothing crashes or loops, and what comes out is
// a result or one line that names the log.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "base/failure.h"
#include "replay/replay.h"
#include "report/recorded_run.h"
#include "report/report.h"
#include "report/report_sections.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::system_test {
namespace {

using ::testing::HasSubstr;

class Damage : public ::testing::TestWithParam<std::pair<const char*, const char*>> {
 protected:
  void SetUp() override {
    const auto& [file, duration_s] = GetParam();
    auto messages = support::in_process_log(support::shortened(file, duration_s));
    num_ticks_ = static_cast<std::int64_t>(messages.size() - 1) / 6;
    messages.push_back(messages[0]);  // a second RUN_INFO, so that most logs stay readable
    whole_ = logger::index_of(logger::log_of(messages));
  }

  void write_damaged(std::uint64_t seed) {
    logger::write_file(path_, logger::damaged_at_random(whole_, seed).bytes);
  }

  /// Numbers anywhere in a message replaced by anything: whole events, so all of it is read.
  void write_with_wild_numbers(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::string bytes = whole_.bytes;
    for (int i = 0; i < 5; ++i) {
      const auto& event = whole_.events[1 + random() % (whole_.events.size() - 2)];
      const std::size_t values = 28 + event.channel.size() + 36;  // header, channel, stamp, count
      if (event.bytes < values + 8) continue;
      const std::size_t at = event.offset + values + 8 * (random() % ((event.bytes - values) / 8));
      for (std::size_t k = 0; k < 8; ++k) bytes[at + k] = static_cast<char>(random());
    }
    logger::write_file(path_, bytes);
  }

  void expect_names_the_log(const base::Failure& failure) const {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr(path_.string()));
  }

  TemporaryDirectory directory_{logger::quick_place()};
  std::filesystem::path path_ = directory_.path() / "lcmlog";
  logger::SampleLog whole_;
  std::int64_t num_ticks_ = 0;
};

// Half of the logs for each of the two robots.
const std::uint64_t num_logs = logger::damage_plan().logs / 2;

TEST_P(Damage, ReplaySurvives) {
  std::uint64_t replayed = 0;
  for (std::uint64_t seed = 0; seed < num_logs; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    seed % 5 == 0 ? write_with_wild_numbers(seed) : write_damaged(seed);
    try {
      auto log = logger::RunLog::open(path_);
      const replay::Replay result =
          replay::replay(log, log.scenario(), controller::scenario_law(log.scenario()));
      ++replayed;
      ASSERT_LE(result.compared, num_ticks_);
      ASSERT_EQ(result.different != 0, result.first.has_value());
      if (result.compared < log.summary().last_tick && result.passed_over == 0) {
        const bool told = !result.complete() || log.summary().gaps() != 0;
        ASSERT_TRUE(told) << "ticks were left out in silence";
      }
    } catch (const base::Failure& failure) {
      expect_names_the_log(failure);
    }
  }
  EXPECT_GT(replayed, num_logs / 2);
  RecordProperty("replayed", std::to_string(replayed));
}

TEST_P(Damage, ReportSurvives) {
  std::uint64_t reported = 0;
  for (std::uint64_t seed = 0; seed < num_logs; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    seed % 5 == 0 ? write_with_wild_numbers(seed) : write_damaged(seed);
    try {
      std::vector<report::RecordedRun> runs;
      runs.push_back(report::read_recorded_run(path_));
      label(runs);
      const report::Overlay all(runs);
      ASSERT_THAT(report::report_page(all, report::report_sections(all)), HasSubstr("</html>"));
      ++reported;
      if (seed % 100 == 0) report::write_report(runs, directory_.path() / "report.html");
    } catch (const base::Failure& failure) {
      ASSERT_EQ(failure.code(), base::ExitCode::bad_usage);
      expect_names_the_log(failure);
    }
  }
  EXPECT_GT(reported, num_logs / 2);
  RecordProperty("reported", std::to_string(reported));
}

INSTANTIATE_TEST_SUITE_P(Robots, Damage,
                         ::testing::Values(std::pair{"practical_rigid.yaml", "0.012"},
                                           std::pair{"practical_flexible.yaml", "0.012"}),
                         [](const auto& robot) {
                           return std::string(robot.index == 0 ? "Rigid" : "Flexible");
                         });

}  // namespace
}  // namespace tachless::system_test
