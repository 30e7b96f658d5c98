// Runs of four real processes in a private network, replayed and reported by the built command.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/json_text.h"
#include "logger/log_file.h"
#include "tests/support/damaged_log.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

using namespace tachless;

namespace {

namespace fs = std::filesystem;
using tachless::support::Outcome;
using ::testing::AllOf;
using ::testing::HasSubstr;

Outcome tachless(const std::string& arguments) {
  return tachless::support::shell(TACHLESS_BINARY_DIR "/bin/tachless " + arguments);
}

/// Returns the place in the log of the last byte of joint `joint`'s torque in tick `tick`.
std::optional<std::uint64_t> last_torque_byte(const fs::path& log, std::int64_t tick, int joint) {
  logger::LogReader reader(log);
  std::int64_t commands = 0;
  while (const auto event = reader.next()) {
    if (event->channel != "ARM_COMMAND" || commands++ != tick) continue;
    const std::uint64_t end =
        event->offset + logger::event_header_bytes + event->channel.size() + event->data.size();
    return end - 1 - 8 * static_cast<std::uint64_t>(1 - joint);
  }
  return {};
}

class ReplayOfARun : public ::testing::Test {
 protected:
  fs::path run(const std::string& scenario, const std::string& options) {
    const fs::path out = directory_.path() / scenario;
    const Outcome outcome =
        tachless("run " TACHLESS_SOURCE_DIR "/scenarios/" + scenario + ".yaml --isolate --quiet " +
                 options + " --out " + out.string());
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return out / "lcmlog";
  }

  TemporaryDirectory directory_;
};

TEST_F(ReplayOfARun, IsTheSameBitForBit) {
  // The runs are shortened, because the whole scenarios take a minute.
  for (const auto& [scenario, options] : std::initializer_list<std::pair<const char*, const char*>>{
           {"paper_rigid", "--duration 0.2"},
           {"practical_rigid", "--duration 1"},
           {"paper_flexible", "--duration 0.02"},
           {"regulation", "--duration 0.5"}}) {
    const fs::path log = run(scenario, options);
    const Outcome replayed = tachless("replay " + log.string());
    EXPECT_EQ(replayed.exit_code, 0) << replayed.output;
    EXPECT_THAT(replayed.output, HasSubstr("bit for bit"));
    EXPECT_TRUE(fs::exists(log.parent_path() / "report.html"));
  }
}

TEST_F(ReplayOfARun, NamesTheTickAndTheJointOfAFlippedBit) {
  const fs::path log = run("practical_rigid", "--duration 0.3");
  const auto at = last_torque_byte(log, 123, 1);
  ASSERT_TRUE(at);
  std::string bytes = logger::read_file(log);
  bytes[*at] = static_cast<char>(bytes[*at] ^ 1);
  logger::write_file(log, bytes);
  const Outcome replayed = tachless("replay " + log.string());
  EXPECT_EQ(replayed.exit_code, 1);
  EXPECT_THAT(replayed.output,
              AllOf(HasSubstr("1 of 300 commands differ, first at tick 123 "),
                    HasSubstr("joint 2 (elbow): recorded "), HasSubstr(", replayed "),
                    HasSubstr(", 1 ulp or "), HasSubstr(" N m apart")));
  EXPECT_EQ(std::count(replayed.output.begin(), replayed.output.end(), '\n'), 1);
  const Outcome as_json = tachless("replay --json " + log.string());
  EXPECT_EQ(as_json.exit_code, 1);
  // The JSON is on stdout and the line for people on stderr. Here both are in one output.
  const std::size_t begin = as_json.output.find('{');
  ASSERT_NE(begin, std::string::npos);
  const auto json =
      base::parse_json(as_json.output.substr(begin, as_json.output.rfind('}') + 1 - begin));
  EXPECT_EQ(json["same"], false);
  EXPECT_EQ(json["first_difference"]["tick"], 123);
  EXPECT_EQ(json["first_difference"]["joint"], 2);
  EXPECT_EQ(json["first_difference"]["ulps"], 1);
}

TEST_F(ReplayOfARun, TellsWhatAnotherLawWouldHaveCommanded) {
  const fs::path log = run("regulation", "--duration 0.2");
  const fs::path out = directory_.path() / "what_if";
  const Outcome same = tachless("replay " + log.string() + " --law kelly_regulation --out " +
                                out.string() + " --json");
  ASSERT_EQ(same.exit_code, 0) << same.output;
  const auto json = base::parse_json(same.output);
  EXPECT_EQ(json["law"], "kelly_regulation");
  EXPECT_EQ(json["compared_ticks"], 200);
  // At a constant reference the laws are equal except for rounding of g(q) and of torques of 2e4 N
  // m.
  EXPECT_LT(json["joints"][0]["max_Nm"].get<double>(), 1e-9);
  EXPECT_THAT(logger::read_file(out / "replay.csv"),
              ::testing::StartsWith("tick,t_s,tau_shoulder_Nm,tau_elbow_Nm,tau_replayed_shoulder_"
                                    "Nm,tau_replayed_elbow_Nm\n0,0,"));
  const Outcome softer =
      tachless("replay " + log.string() + " --set 'controller.gains.kp=[20000, 2400]' --out " +
               out.string());
  EXPECT_EQ(softer.exit_code, 0) << softer.output;
  EXPECT_THAT(softer.output, HasSubstr("replayed - recorded torque"));
  for (const std::string options :
       {"--set plant.payload.mass_kg=1", "--law slotine_li", "--law nothing",
        "--set controller.x=1", "--set loop.command_delay=17"}) {
    const Outcome refused = tachless("replay " + log.string() + " " + options + " --out " +
                                     (directory_.path() / "none").string());
    EXPECT_EQ(refused.exit_code, 2) << options << "\n" << refused.output;
    EXPECT_EQ(std::count(refused.output.begin(), refused.output.end(), '\n'), 1) << refused.output;
  }
}

TEST_F(ReplayOfARun, ReportOverlaysLogs) {
  const fs::path log = run("regulation", "--duration 0.1");
  const fs::path page = directory_.path() / "page.html";
  const Outcome outcome =
      tachless("report " + log.string() + " " + log.string() + " -o " + page.string());
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(outcome.output, page.string() + "\n");
  EXPECT_THAT(logger::read_file(page), HasSubstr("class=\"legend\""));
}

}  // namespace
