#include "session/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "tests/support/temporary_directory.h"

namespace tachless::session {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

std::optional<ProcessOptions> parse(messages::Role role, std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "program");
  return parse_process_options(role, static_cast<int>(arguments.size()), arguments.data());
}

std::string refusal(messages::Role role, const std::vector<const char*>& arguments) {
  try {
    parse(role, arguments);
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), Not(HasSubstr("\n")));
    return failure.what();
  }
  return "accepted";
}

TEST(RunId, IsValidForEveryTime) {
  using namespace std::chrono_literals;
  const std::chrono::system_clock::time_point in_1970;
  EXPECT_EQ(run_id_at(in_1970 + 1s), 1'000'000);
  EXPECT_EQ(run_id_at(in_1970), 1);
  EXPECT_EQ(run_id_at(in_1970 - std::chrono::years(10)), 1);
  EXPECT_EQ(run_id_at(in_1970 + std::chrono::years(290)), 9'000'000'000'000'000);
}

TEST(ProcessOptions, AreReadFromTheCommandLine) {
  const auto options =
      parse(messages::Role::plant, {"a.yaml", "--set", "loop.period_s=1e-3", "--set", "name=x",
                                    "--lcm-url", "udpm://239.255.76.67:7700?ttl=0", "--run-id",
                                    "42", "--wait-s", "2.5", "--stats", "s.json", "--verbose"});
  ASSERT_TRUE(options);
  EXPECT_EQ(options->scenario_path, "a.yaml");
  EXPECT_THAT(options->overrides, ElementsAre("loop.period_s=1e-3", "name=x"));
  EXPECT_EQ(options->lcm_url, "udpm://239.255.76.67:7700?ttl=0");
  EXPECT_EQ(options->run_id, 42);
  EXPECT_EQ(options->wait_s, 2.5);
  EXPECT_EQ(options->stats_path, "s.json");
  EXPECT_EQ(options->verbosity, base::Verbosity::verbose);
}

TEST(ProcessOptions, AKeyFileWithoutANameIsNotTakenForNoKey) {
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--key-file", ""}),
              AllOf(HasSubstr("--key-file"), HasSubstr("empty")));
}

TEST(ProcessOptions, AnEmptyWordIsNotTakenForAnOptionThatIsNotGiven) {
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--stats", ""}),
              StartsWith("--stats: empty; give a value, or leave the option out"));
  EXPECT_THAT(refusal(messages::Role::logger, {"a.yaml", "--out-log", ""}),
              StartsWith("--out-log: empty"));
  EXPECT_THAT(refusal(messages::Role::logger, {""}), StartsWith("SCENARIO: empty; give a value"));
}

TEST(ProcessOptions, AScenarioMayFollowAnOverride) {
  const auto options = parse(messages::Role::reference, {"--set", "name=x", "a.yaml"});
  ASSERT_TRUE(options);
  EXPECT_EQ(options->scenario_path, "a.yaml");
  EXPECT_THAT(options->overrides, ElementsAre("name=x"));
}

TEST(ProcessOptions, AnOverrideMayHoldCommasBracketsAndBraces) {
  const auto options =
      parse(messages::Role::plant, {"a.yaml", "--set", "reference={hold: {position_rad: [0, 1]}}",
                                    "--set", "controller.gains.kp=[1,2]"});
  ASSERT_TRUE(options);
  EXPECT_THAT(options->overrides,
              ElementsAre("reference={hold: {position_rad: [0, 1]}}", "controller.gains.kp=[1,2]"));
}

TEST(ProcessOptions, DefaultToOneHostNoRunIdAndUnlimitedWait) {
  unsetenv("LCM_DEFAULT_URL");
  const auto options = parse(messages::Role::controller, {"a.yaml"});
  ASSERT_TRUE(options);
  EXPECT_EQ(options->lcm_url, "udpm://239.255.76.67:7667?ttl=0");
  EXPECT_FALSE(options->run_id);
  EXPECT_EQ(options->wait_s, 0);
  EXPECT_EQ(options->stats_path, "");
  EXPECT_EQ(options->verbosity, base::Verbosity::normal);
}

TEST(ProcessOptions, HonourLcmDefaultUrlUnlessTheOptionIsGiven) {
  setenv("LCM_DEFAULT_URL", "udpm://239.255.76.67:7701?ttl=1", 1);
  EXPECT_EQ(parse(messages::Role::logger, {"a.yaml"})->lcm_url, "udpm://239.255.76.67:7701?ttl=1");
  EXPECT_EQ(
      parse(messages::Role::logger, {"a.yaml", "--lcm-url", "udpm://239.255.76.67:7702"})->lcm_url,
      "udpm://239.255.76.67:7702");
  unsetenv("LCM_DEFAULT_URL");
}

TEST(ProcessOptions, AWrongLcmDefaultUrlIsNotTakenForAnOption) {
  setenv("LCM_DEFAULT_URL", "udp://nowhere", 1);
  try {
    parse_lcm_url(parse(messages::Role::logger, {"a.yaml"})->lcm_url);
    ADD_FAILURE() << "accepted";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), StartsWith("LCM URL 'udp://nowhere': "));
  }
  unsetenv("LCM_DEFAULT_URL");
}

TEST(ProcessOptions, RefuseBadUsageInOneLineThatNamesTheOption) {
  EXPECT_THAT(refusal(messages::Role::plant, {}), HasSubstr("SCENARIO"));
  EXPECT_THAT(refusal(messages::Role::plant, {""}), HasSubstr("SCENARIO"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "b.yaml"}), HasSubstr("b.yaml"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--nonsense"}),
              AllOf(HasSubstr("--nonsense"), HasSubstr("tachless-plant --help")));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--run-id", "0"}),
              AllOf(HasSubstr("--run-id"), HasSubstr("0")));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--run-id", "-3"}), HasSubstr("-3"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--run-id", "seven"}), HasSubstr("seven"));
  EXPECT_THAT(refusal(messages::Role::reference, {"a.yaml", "--run-id", "7"}),
              HasSubstr("--run-id"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--wait-s", "-1"}), HasSubstr("--wait-s"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--wait-s", "nan"}), HasSubstr("--wait-s"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--out-log", "x"}), HasSubstr("--out-log"));
  EXPECT_THAT(refusal(messages::Role::logger, {"a.yaml", "--set"}), HasSubstr("--set"));
  EXPECT_THAT(refusal(messages::Role::plant, {"a.yaml", "--quiet", "--verbose"}),
              HasSubstr("quiet"));
}

TEST(ProcessOptions, HelpShowsExamplesAndVersionTheVersion) {
  ::testing::internal::CaptureStdout();
  EXPECT_FALSE(parse(messages::Role::logger, {"--help"}));
  EXPECT_THAT(::testing::internal::GetCapturedStdout(),
              AllOf(HasSubstr("Examples:"), HasSubstr("--out-log"), HasSubstr("1 a check failed"),
                    Not(HasSubstr("--run-id"))));
  ::testing::internal::CaptureStdout();
  EXPECT_FALSE(parse(messages::Role::plant, {"--version"}));
  EXPECT_THAT(::testing::internal::GetCapturedStdout(), ::testing::MatchesRegex("[0-9.]+\n"));
}

TEST(ProcessOptions, TheLogTakesTheNextFreeNumberOfTheDay) {
  const TemporaryDirectory directory;
  std::tm date{};
  date.tm_year = 2025 - 1900;
  date.tm_mon = 2;
  date.tm_mday = 7;
  EXPECT_EQ(next_log_path(directory.path(), date), directory / "lcmlog-2025-03-07.00");
  std::ofstream(directory / "lcmlog-2025-03-07.00") << "x";
  EXPECT_EQ(next_log_path(directory.path(), date), directory / "lcmlog-2025-03-07.01");
}

int run_with(const std::function<base::ExitCode(const ProcessOptions&)>& run, std::string& shown) {
  const char* const arguments[] = {"program", "a.yaml"};
  ::testing::internal::CaptureStderr();
  const int code = run_process(messages::Role::plant, 2, arguments, run);
  shown = ::testing::internal::GetCapturedStderr();
  return code;
}

TEST(RunProcess, TurnsAFailureIntoOneLineAndItsExitCode) {
  std::string shown;
  EXPECT_EQ(run_with(
                [](const ProcessOptions&) -> base::ExitCode {
                  throw base::Failure(base::ExitCode::peer_lost,
                                      "controller is silent {since} 5 s");
                },
                shown),
            3);
  EXPECT_EQ(shown, "tachless-plant: controller is silent {since} 5 s\n");
}

TEST(RunProcess, ReportsAnUnexpectedExceptionInOneLine) {
  std::string shown;
  EXPECT_EQ(
      run_with(
          [](const ProcessOptions&) -> base::ExitCode { throw std::logic_error("first\nsecond"); },
          shown),
      4);
  EXPECT_THAT(shown, HasSubstr("internal error: first second"));
}

TEST(RunProcess, PassesTheExitCodeOn) {
  std::string shown;
  EXPECT_EQ(run_with([](const ProcessOptions&) { return base::ExitCode::protective_stop; }, shown),
            5);
  EXPECT_EQ(shown, "");
}

}  // namespace
}  // namespace tachless::session
