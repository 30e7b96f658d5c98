// Each program has a host on a switch. These tests check the links and hosts of docs/faults.md.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/json_text.h"
#include "logger/run_log.h"
#include "messages/truth/plant_truth.h"
#include "tests/support/private_network.h"
#include "tests/system/four_hosts.h"

namespace tachless::several_hosts_test {
namespace {

using namespace std::chrono_literals;
using messages::truth::DriveFault;
using system_test::FourHosts;
using system_test::FourHostsRun;
using system_test::FourPrograms;
using system_test::roles;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::vector<std::string> set(const std::vector<std::string>& values) {
  std::vector<std::string> options;
  for (const std::string& each : values) options.insert(options.end(), {"--set", each});
  return options;
}

nlohmann::json statistics(const FourPrograms& run, const std::string& role) {
  return base::parse_json(contents(run.statistics_path(role)));
}

/// Waits until the log has `bytes`: the run is under way.
void wait_for_log(FourPrograms& run, std::uintmax_t bytes) {
  while (run.log_size() < bytes) {
    ASSERT_TRUE(run["plant"].running() && run["logger"].running())
        << run["plant"].errors() << run["logger"].errors();
    std::this_thread::sleep_for(1ms);
  }
}

constexpr std::uintmax_t under_way = 200'000;  // bytes: some hundred ticks

std::vector<logger::TickRecord> ticks_of(const std::filesystem::path& path) {
  std::vector<logger::TickRecord> ticks;
  logger::RunLog log = logger::RunLog::open(path);
  logger::TickRecord record;
  while (log.next(record)) ticks.push_back(record);
  return ticks;
}

/// Counts gaps between commands that are too long for the law's memory (docs/realtime.md).
int too_long_gaps_between_commands(const std::vector<logger::TickRecord>& ticks) {
  constexpr std::int64_t longest_bridged = 64;
  std::optional<std::int64_t> last;
  int too_long = 0;
  for (const logger::TickRecord& each : ticks) {
    if (!each.command) continue;
    if (last && each.tick - *last > longest_bridged) ++too_long;
    last = each.tick;
  }
  return too_long;
}

/// Returns a failed run's log without its last event, which says why (docs/log.md).
std::string without_the_fault(const std::string& log) {
  const std::size_t last = log.rfind("\xed\xa1\xda\x01");  // the start of every event
  const bool says_why = log.find("ARM_PARTICIPANT", last) != std::string::npos;
  return says_why ? log.substr(0, last) : log;
}

// --- Lock-step --------------------------------------------------------------------------------

class LockstepOnFourHosts : public testing::Test {
 protected:
  LockstepOnFourHosts() { run.programs.settings = settings; }

  /// Returns the log of the same run on one host, without any fault.
  static const std::string& clean() {
    static const std::string log = [] {
      FourPrograms one_host(scenario);
      one_host.settings = settings;
      one_host.start_all();
      one_host.expect_all_done();
      return contents(one_host.log_path());
    }();
    return log;
  }

  void expect_the_clean_log() {
    ASSERT_FALSE(clean().empty());
    run.programs.expect_all_done();
    EXPECT_TRUE(contents(run.programs.log_path()) == clean());
  }

  static constexpr const char* scenario = "practical_rigid.yaml";
  // A busy machine may give these programs no time for less than this. They are not dead then.
  static constexpr const char* impatient = "loop.give_up_s=4";
  // The kernel reports within a second that a port is up again. It takes longer if other tests hold
  // the lock of its network devices. Two seconds without a link were three in one of forty, and
  // once five. The tests are not about this delay.
  static inline const std::vector<std::string> settings =
      set({"loop.duration_s=4", "loop.give_up_s=15"});
  FourHostsRun run{scenario};
};

TEST_F(LockstepOnFourHosts, GivesTheLogOfOneHost) {
  run.start_all();
  expect_the_clean_log();
}

TEST_F(LockstepOnFourHosts, GivesTheSameLogWithTenPercentOfAllPacketsLost) {
  run.hosts.lose(10);
  run.start_all();
  expect_the_clean_log();
  EXPECT_GT(statistics(run.programs, "plant").at("resends"), 0);
}

TEST_F(LockstepOnFourHosts, LosesNothingWhenALinkIsDownFor100Milliseconds) {
  for (const std::string role : roles) {
    SCOPED_TRACE(role);
    run.start_all();
    wait_for_log(run.programs, under_way);
    run.hosts.unplug(role);
    std::this_thread::sleep_for(100ms);
    run.hosts.plug(role);
    expect_the_clean_log();
    EXPECT_GT(statistics(run.programs, "plant").at("resends"), 0) << "the run was over before";
    std::filesystem::remove(run.programs.log_path());
  }
}

TEST_F(LockstepOnFourHosts, LosesNothingWhenALinkIsDownForTwoSeconds) {
  run.start_all();
  wait_for_log(run.programs, under_way);
  run.hosts.unplug("controller");
  std::this_thread::sleep_for(2s);
  EXPECT_LT(run.programs.log_size(), clean().size());
  run.hosts.plug("controller");
  expect_the_clean_log();
}

TEST_F(LockstepOnFourHosts, EndsOnBothSidesOfALinkThatIsDownForLongerThanTheTimeToGiveUp) {
  run.programs.settings = set({"loop.duration_s=4", impatient});
  run.start_all();
  wait_for_log(run.programs, under_way);
  run.hosts.unplug("controller");
  for (const char* role : roles) EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
  EXPECT_THAT(run["plant"].errors(), AllOf(HasSubstr("controller-host"), HasSubstr("4 s")));
  EXPECT_THAT(run["controller"].errors(), AllOf(HasSubstr("plant-host"), HasSubstr("4 s")));

  // The log has whole ticks. It is the beginning of the log of the run that ends well.
  const std::string first = without_the_fault(contents(run.programs.log_path()));
  for (const logger::TickRecord& each : ticks_of(run.programs.log_path())) {
    for (const messages::Slot piece : messages::all_slots) {
      // There is no contact without plant.mujoco, and no arm that tells torques.
      if (piece == messages::Slot::contact || piece == messages::Slot::arm_torque) continue;
      EXPECT_TRUE(has(each, piece)) << each.tick;
    }
  }
  std::filesystem::remove(run.programs.log_path());
  run.hosts.plug("controller");
  run.start_all();
  run.programs.expect_all_done();
  const std::string log = contents(run.programs.log_path());
  EXPECT_GE(first.size(), under_way);
  EXPECT_LT(first.size(), log.size());
  EXPECT_TRUE(log.starts_with(first));
}

TEST_F(LockstepOnFourHosts, AProgramThatAFirewallKeepsFromSendingSaysSo) {
  run.programs.settings = set({"loop.duration_s=60", impatient});
  run.start_all();
  wait_for_log(run.programs, under_way);
  run.hosts.forbid_sending("controller");
  for (const char* role : roles) EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
  EXPECT_THAT(run["plant"].errors(), HasSubstr("controller-host"));
  EXPECT_THAT(run["controller"].errors(),
              HasSubstr("messages could not be sent (Operation not permitted)"));
}

class LockstepWithoutOneHost : public LockstepOnFourHosts,
                               public testing::WithParamInterface<const char*> {};

TEST_P(LockstepWithoutOneHost, EndsNamingItAndItsSuccessorWaitsForTheNextRun) {
  const std::string lost = GetParam();
  run.programs.settings = set({"loop.duration_s=4", impatient});
  run.start_all();
  wait_for_log(run.programs, under_way);
  run[lost].signal(SIGKILL);
  EXPECT_EQ(run[lost].wait(), 128 + SIGKILL);
  const std::filesystem::path first_log = run.programs.directory() / "first";
  const auto keep_log = [&] { std::filesystem::rename(run.programs.log_path(), first_log); };
  if (lost == "logger") keep_log();  // the next one begins another

  // The successor starts at once, before the others notice.
  run.start(lost);
  for (const char* role : roles) {
    if (role == lost) continue;
    EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
    EXPECT_THAT(run[role].errors(), HasSubstr(lost + "-host"));
  }
  if (lost != "logger") keep_log();
  // The log is the beginning of a whole one: nothing is missing in between.
  const std::vector<logger::TickRecord> ticks = ticks_of(first_log);
  EXPECT_GT(ticks.size(), 100U);

  for (const char* role : roles) {
    if (role != lost) run.start(role);
  }
  run.programs.expect_all_done();
  const std::string log = contents(run.programs.log_path());
  EXPECT_GT(log.size(), under_way);
  const std::string first = without_the_fault(contents(first_log));
  EXPECT_LT(first.size(), log.size());
  EXPECT_TRUE(log.starts_with(first));
}

INSTANTIATE_TEST_SUITE_P(Killed, LockstepWithoutOneHost, testing::ValuesIn(roles),
                         [](const auto& each) { return std::string(each.param); });

// --- Realtime ---------------------------------------------------------------------------------

class RealtimeOnFourHosts : public testing::Test {
 protected:
  void play(const std::vector<std::string>& values) {
    run.programs.settings = set(values);
    run.programs.settings.insert(run.programs.settings.end(), {"--set", "loop.mode=realtime",
                                                               "--set", "loop.max_missed_share=1"});
    run.start_all();
  }
  [[nodiscard]] nlohmann::json of(const std::string& role) const {
    return statistics(run.programs, role);
  }
  /// Cuts the link of `role` for `duration`, once the run is under way.
  void cut(const std::string& role, std::chrono::milliseconds duration) {
    wait_for_log(run.programs, under_way);
    run.hosts.unplug(role);
    std::this_thread::sleep_for(duration);
    run.hosts.plug(role);
  }
  void expect(const std::vector<std::string>& whom, int code, const std::string& message) {
    for (const std::string& role : whom) {
      EXPECT_EQ(run[role].wait(), code) << role << ": " << run[role].errors();
      EXPECT_THAT(run[role].errors(), HasSubstr(message)) << role;
    }
  }
  /// Returns the last TRUTH that is recorded.
  [[nodiscard]] messages::truth::PlantTruth last_truth() const {
    messages::truth::PlantTruth last;
    for (const logger::TickRecord& each : ticks_of(run.programs.log_path())) {
      if (each.truth) last = *each.truth;
    }
    return last;
  }

  // No busy machine makes a controller miss so many in a row. Only the network may stop a run that
  // must go on for its test.
  static constexpr const char* patient = "loop.max_missed=2000";
  // A link that is down for 200 ms costs more.
  static constexpr const char* impatient = "loop.max_missed=50";
  static constexpr const char* too_many = "51 commands in a row did not come";
  FourHostsRun run{"practical_rigid.yaml"};
};

TEST_F(RealtimeOnFourHosts, RunsAtOneKilohertz) {
  play({"loop.duration_s=2", patient});
  run.programs.expect_all_done();
  EXPECT_EQ(of("plant").at("ticks"), 2000);
  EXPECT_EQ(
      of("logger").at("log").at("ticks").get<int>() + of("logger").at("log").at("gaps").get<int>(),
      2000);
  // This network loses nothing. Only ticks that a busy controller skipped are missing.
  EXPECT_EQ(of("logger").at("log").at("gaps"), of("controller").at("skipped_ticks"));
}

TEST_F(RealtimeOnFourHosts, GoesOnWithTenPercentOfAllPacketsLostAndCountsThem) {
  run.hosts.lose(10);
  play({"loop.duration_s=2", patient});
  run.programs.expect_all_done();
  EXPECT_EQ(of("plant").at("ticks"), 2000);
  EXPECT_GT(of("plant").at("missed_commands"), 0);
  EXPECT_GT(of("controller").at("skipped_ticks"), 0);
  EXPECT_GT(of("logger").at("log").at("gaps"), 0);
  EXPECT_THAT(run["logger"].errors(), HasSubstr("of 2000 ticks have no ARM_TRUTH"));
  EXPECT_THAT(run["controller"].errors(), HasSubstr("gaps were skipped"));
}

TEST_F(RealtimeOnFourHosts, HoldsTheLastTorqueWhileALinkIsDownForLessThanMaxMissed) {
  play({"loop.duration_s=4", patient, "reference={hold: {position_rad: [0, 0]}}"});
  cut("controller", 500ms);
  run.programs.expect_all_done();
  // The plant catches up on late ticks. A plant that stood still in the cut has fewer of them
  // without a link.
  constexpr int at_least = 200;
  EXPECT_GE(of("plant").at("longest_command_miss"), at_least);
  EXPECT_GE(of("controller").at("skipped_ticks"), at_least);
  const auto ticks = ticks_of(run.programs.log_path());
  // It is one, unless the machine stood still as long at another time.
  EXPECT_GE(of("controller").at("restarts"), 1) << "too long for the law's memory";
  EXPECT_EQ(of("controller").at("restarts"), too_long_gaps_between_commands(ticks));
  EXPECT_THAT(run["controller"].errors(), HasSubstr("the law's memory began anew"));
  std::optional<Vector> torque;
  int held = 0;
  for (const logger::TickRecord& each : ticks) {
    if (!each.truth) continue;
    if (torque && each.truth->fault == DriveFault::command_missed) {
      ++held;
      EXPECT_EQ(each.truth->tau, *torque) << each.tick;
    }
    torque = each.truth->tau;
  }
  EXPECT_GE(held, at_least);
}

TEST_F(RealtimeOnFourHosts, EndsInAProtectiveStopWhenALinkIsDownForLongerThanMaxMissed) {
  for (const std::string lost : {"controller", "reference"}) {
    SCOPED_TRACE(lost);
    play({"loop.duration_s=40", impatient});
    cut(lost, 200ms);
    // The link is back before the robot is at rest: all hear why.
    expect({"plant", "reference", "controller", "logger"}, 5, too_many);
    EXPECT_THAT(run["plant"].errors(), HasSubstr(lost + "-host"));
    EXPECT_EQ(last_truth().fault, DriveFault::protective_stop);
    EXPECT_EQ(last_truth().tau, Vector::Zero(2));
    std::filesystem::remove(run.programs.log_path());
  }
}

TEST_F(RealtimeOnFourHosts, StaysStoppedWhenALinkComesBackAfterTwoSecondsUntilANewRun) {
  play({"loop.duration_s=40", "loop.give_up_s=2", impatient});
  cut("controller", 2s);
  expect({"plant", "reference", "logger"}, 5, too_many);
  expect({"controller"}, 3, "plant-host");
  EXPECT_EQ(last_truth().fault, DriveFault::protective_stop);
  std::filesystem::remove(run.programs.log_path());
  play({"loop.duration_s=0.5", patient});
  run.programs.expect_all_done();
}

TEST_F(RealtimeOnFourHosts, ThePlantStopsByItselfWhenItsOwnLinkIsDown) {
  play({"loop.duration_s=40", "loop.give_up_s=2", impatient});
  cut("plant", 2s);
  expect({"plant"}, 5, too_many);
  expect({"reference", "controller", "logger"}, 3, "plant-host");
  EXPECT_GT(ticks_of(run.programs.log_path()).size(), 100U);
}

TEST_F(RealtimeOnFourHosts, ARecordersLinkThatIsDownForTwoSecondsStopsNobodyAndTheGapIsNamed) {
  play({"loop.duration_s=10", patient});
  cut("logger", 2s);
  run.programs.expect_all_done();
  const std::vector<logger::TickRecord> ticks = ticks_of(run.programs.log_path());
  const auto recorded =
      std::count_if(ticks.begin(), ticks.end(), [](const auto& tick) { return tick.truth; });
  const auto unrecorded = 10'000 - recorded;
  // It is half of the cut at least: a busy machine makes fewer ticks in those two seconds.
  EXPECT_GE(unrecorded, 1000);
  EXPECT_GE(of("logger").at("log").at("gaps"), unrecorded);
  EXPECT_THAT(run["logger"].errors(),
              HasSubstr(fmt::format("{} of 10000 ticks have no ARM_TRUTH", unrecorded)));
  // A plant that depended on the recorder would miss some two thousand.
  EXPECT_LT(of("plant").at("longest_command_miss"), 1000);
}

TEST_F(RealtimeOnFourHosts, EndsInAProtectiveStopWhenTheControllerOrTheReferenceIsKilled) {
  for (const std::string lost : {"controller", "reference"}) {
    SCOPED_TRACE(lost);
    play({"loop.duration_s=40", impatient});
    wait_for_log(run.programs, under_way);
    run[lost].signal(SIGKILL);
    for (const char* role : roles) {
      if (role != lost) expect({role}, 5, too_many);
    }
    EXPECT_THAT(run["plant"].errors(), HasSubstr(lost + "-host"));
    EXPECT_EQ(last_truth().fault, DriveFault::protective_stop);
    std::filesystem::remove(run.programs.log_path());
  }
}

TEST_F(RealtimeOnFourHosts, BringsTheRobotToRestWhenTheLoggerIsKilled) {
  play({"loop.duration_s=40", "loop.give_up_s=2", patient});
  wait_for_log(run.programs, under_way);
  run["logger"].signal(SIGKILL);
  expect({"plant", "reference", "controller"}, 3, "logger-host");
  EXPECT_GT(ticks_of(run.programs.log_path()).size(), 100U);
}

TEST_F(RealtimeOnFourHosts, EndsNamingThePlantWhenItIsKilled) {
  play({"loop.duration_s=40", "loop.give_up_s=2", patient});
  wait_for_log(run.programs, under_way);
  run["plant"].signal(SIGKILL);
  expect({"reference", "controller", "logger"}, 3, "plant-host");
  EXPECT_GT(ticks_of(run.programs.log_path()).size(), 100U);
}

}  // namespace
}  // namespace tachless::several_hosts_test
