// These tests change gains while the four programs run: `tachless gains`, the log, its replay.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "base/json_text.h"
#include "bus/udp_transport.h"
#include "logger/run_log.h"
#include "messages/wire.h"
#include "scenario/scenario.h"
#include "tests/support/private_network.h"
#include "tests/system/four_programs.h"

namespace tachless::gains_test {
namespace {

using system_test::FourPrograms;
using system_test::roles;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class GainsInARun : public testing::Test {
 protected:
  /// Starts a run of two joints in simulation time, for as long as the test wants.
  void play(std::vector<std::string> more = {}) {
    run.settings = {"--set", "loop.duration_s=10000"};
    run.settings.insert(run.settings.end(), more.begin(), more.end());
    run.start_all();
    wait_until("the log grows", [&] { return run.log_size() > 50'000; });
  }
  /// Runs the verb and returns its exit code. `said` becomes its output.
  int change(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "gains");
    Program program("tachless", arguments, run.directory().path());
    const int code = program.wait();
    said = program.output() + program.errors();
    return code;
  }
  int tachless(const std::vector<std::string>& arguments) {
    Program program("tachless", arguments, run.directory().path());
    const int code = program.wait();
    said = program.output() + program.errors();
    return code;
  }
  void end() {
    run["plant"].signal(SIGINT);
    for (const char* role : roles) run[role].wait();
  }

  FourPrograms run{"practical_rigid.yaml"};
  std::string said;
};

const std::vector<std::string> may_change = {"--set", "controller.gains_may_change=true"};

TEST_F(GainsInARun, TakeEffectAtATickThatLogAndReplayHave) {
  play(may_change);
  ASSERT_EQ(change({"arm", "kp=[300, 100]", "--json"}), 0) << said;
  const auto first = base::parse_json(said.substr(0, said.rfind('}') + 1));
  EXPECT_THAT(first.at("gains").get<std::string>(), HasSubstr("kp=300,100"));
  // Gains that are not named stay as the first change has left them.
  ASSERT_EQ(change({"ARM", "kd=[40, 12]", "--json"}), 0) << said;
  const auto second = base::parse_json(said.substr(0, said.rfind('}') + 1));
  EXPECT_THAT(second.at("gains").get<std::string>(),
              AllOf(HasSubstr("kp=300,100"), HasSubstr("kd=40,12")));
  // The plant has begun that tick, but may not have ended it. A run that ends now may lack it.
  wait_until("the log has the tick of the second change, and later ones", [&] {
    const std::string log = contents(run.log_path());
    const std::size_t at = log.find(second.at("gains").get<std::string>());
    return at != std::string::npos && log.size() > at + 50'000;
  });
  end();

  logger::RunLog log = logger::RunLog::open(run.log_path());
  logger::TickRecord record;
  while (log.next(record)) continue;
  const auto& changes = log.summary().gains;
  ASSERT_EQ(changes.size(), 2U);
  EXPECT_EQ(changes[0].tick, first.at("tick"));
  EXPECT_EQ(changes[1].tick, second.at("tick"));
  EXPECT_EQ(changes[1].gains, second.at("gains").get<std::string>());
  EXPECT_GE(log.summary().last_tick, changes[1].tick);  // the run is ended soon after

  EXPECT_EQ(tachless({"replay", run.log_path()}), 0) << said;
  EXPECT_EQ(tachless({"info", run.log_path()}), 0) << said;
  EXPECT_THAT(said, HasSubstr("gains     from tick " + std::to_string(changes[0].tick)));
  // The log without its changes differs from the results of the controller.
  std::string bytes = contents(run.log_path());
  const std::string gains = changes[0].gains;
  std::string other = gains;
  other.replace(other.find("kp=300"), 6, "kp=299");
  for (std::size_t at = bytes.find(gains); at != std::string::npos; at = bytes.find(gains, at)) {
    bytes.replace(at, other.size(), other);
  }
  const std::string forged = (run.directory() / "forged").string();
  std::ofstream(forged, std::ios::binary) << bytes;
  EXPECT_EQ(tachless({"replay", forged}), 1) << said;
  EXPECT_THAT(said, HasSubstr("tick " + std::to_string(changes[0].tick)));
}

TEST_F(GainsInARun, AreRefusedWhereTheyAreUnstableUnknownOrNotAllowed) {
  EXPECT_EQ(change({"arm", "kp=1"}), 3);
  EXPECT_THAT(said, HasSubstr("no run of that robot is heard"));
  play(may_change);
  EXPECT_EQ(change({"arm", "kp=1e9"}), 2);
  EXPECT_THAT(said, AllOf(HasSubstr("not sent"), HasSubstr("unstable")));
  EXPECT_EQ(change({"arm", "ki=3"}), 2);
  EXPECT_THAT(said, StartsWith("tachless: ki=3: controller.gains.ki: ")) << "as typed";
  EXPECT_EQ(change({"arm", "kp=-3"}), 2);
  EXPECT_THAT(said, StartsWith("tachless: kp=-3: controller.gains.kp: "));
  EXPECT_EQ(change({"arm", "kp=abc"}), 2);
  EXPECT_THAT(said, StartsWith("tachless: kp=abc: controller.gains.kp: "));
  EXPECT_EQ(change({"arm", "nonsense"}), 2);
  end();
  logger::RunLog log = logger::RunLog::open(run.log_path());
  logger::TickRecord record;
  while (log.next(record)) continue;
  EXPECT_TRUE(log.summary().gains.empty());
}

/// Another count would end the run: the law's memory has the size of the first.
TEST_F(GainsInARun, KeepTheCountsThatTheRunBeganWith) {
  play({"--set",
        "controller={law: kalman_velocity, gains: {kp: [4000, 240], kd: [200, 12], "
        "process_noise: 100, order: 2}, gains_may_change: true}"});
  EXPECT_EQ(change({"arm", "order=3"}), 2) << said;
  EXPECT_THAT(said, HasSubstr("controller.gains.order: a count sizes the law's memory"));
  EXPECT_EQ(change({"arm", "order=2", "kp=[3000, 200]"}), 0) << said;
  end();
}

TEST_F(GainsInARun, AreChangedWhateverElseIsSentOnTheRunsChannels) {
  play(may_change);
  std::atomic<bool> done = false;
  std::thread stranger([&] {
    bus::UdpTransport bus;
    const std::array<std::byte, 5> no_stamp{};
    while (!done) {
      bus.publish("ARM_RUN_INFO", no_stamp);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  EXPECT_EQ(change({"arm", "kp=[300, 100]"}), 0) << said;
  done = true;
  stranger.join();
  end();
}

/// A recorded session may show its sender other gains than those in force.
TEST_F(GainsInARun, AreNotReplacedByASenderThatHasSeenOthers) {
  play(may_change);
  ASSERT_EQ(change({"arm", "kd=[40, 12]", "--json"}), 0) << said;
  const auto first = base::parse_json(said.substr(0, said.rfind('}') + 1));
  const std::string in_force = first.at("gains");
  wait_until("later ticks are in the log",
             [&, size = run.log_size()] { return run.log_size() > size + 50'000; });

  messages::Codec<messages::GainChange> codec{messages::Layout{}};
  auto acks = messages::port<messages::GainAck>("ARM", {});
  const std::int64_t digest =
      scenario::load_scenario(system_test::scenarios + "practical_rigid.yaml",
                              {"loop.duration_s=10000", "controller.gains_may_change=true"})
          .digest;
  const messages::Stamp stamp{0, 7, first.at("tick").get<std::int64_t>() + 1};
  bus::UdpTransport bus;
  bus.subscribe(acks.channel);
  const auto send = [&](const std::string& replaces, std::int64_t number) {
    bus.publish("ARM_GAINS", codec.encode(stamp, {"kp=300,100", replaces, digest, number}));
  };
  send("", 5);
  send("kd=41,12", 6);
  send(in_force, 7);
  const auto ack = bus.receive(base::Clock::now() + std::chrono::seconds(60));
  ASSERT_TRUE(ack);
  messages::Stamp changed_at;
  messages::GainAck acknowledged;
  ASSERT_EQ(acks.codec.decode(ack->payload, changed_at, acknowledged), messages::Rejection::none);
  EXPECT_EQ(acknowledged.number, 7);
  end();
}

TEST_F(GainsInARun, StayWhereTheScenarioDoesNotLetThemChange) {
  play();
  EXPECT_EQ(change({"arm", "kp=[300, 100]"}), 2);
  EXPECT_THAT(said, HasSubstr("controller.gains_may_change=true"));
  end();
}

TEST_F(GainsInARun, NeedTheKeyOfTheBus) {
  const std::string key = (run.directory() / "key").string();
  std::ofstream(key) << std::string(32, 'k');
  std::filesystem::permissions(key, std::filesystem::perms::owner_read);
  std::vector<std::string> more = may_change;
  more.insert(more.end(), {"--key-file", key});
  play(more);
  EXPECT_EQ(change({"arm", "kp=[300, 100]"}), 3) << said;
  EXPECT_EQ(change({"arm", "kp=[300, 100]", "--key-file", key}), 0) << said;
  end();
}

}  // namespace
}  // namespace tachless::gains_test
