// A million hostile datagrams at a running loop, and neighbours on one bus.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "tests/soak/hostile_traffic.h"
#include "tests/support/private_network.h"
#include "tests/support/sanitizer.h"
#include "tests/system/four_programs.h"

using namespace tachless;

namespace {

using soak::HostileTraffic;
using system_test::FourPrograms;
using system_test::roles;
using ::testing::HasSubstr;

constexpr std::int64_t run_id = 7;

std::vector<std::string> settings(std::vector<std::string> more = {}) {
  // 150,000 ticks, so that all datagrams are sent first. A flood can drown heartbeats for long on a
  // busy machine: nobody gives up.
  more.insert(more.end(), {"--set", "loop.duration_s=150", "--set", "loop.give_up_s=60"});
  return more;
}

/// Resident memory [KiB].
std::int64_t resident_kib(const Program& program) {
  std::ifstream file("/proc/" + std::to_string(program.pid()) + "/status");
  std::string word;
  while (file >> word) {
    if (word != "VmRSS:") continue;
    std::int64_t value = 0;
    file >> value;
    return value;
  }
  throw std::runtime_error("a program has ended: " + program.errors());
}

std::map<std::string, std::int64_t> memory(FourPrograms& run) {
  std::map<std::string, std::int64_t> result;
  for (const char* role : roles) result[role] = resident_kib(run[role]);
  return result;
}

/// Dropped messages by reason, of all four.
std::map<std::string, std::int64_t> rejected(const FourPrograms& run) {
  std::map<std::string, std::int64_t> result;
  for (const char* role : roles) {
    const auto json = nlohmann::json::parse(contents(run.statistics_path(role)));
    for (const auto& [reason, count] : json.at("rejected").items()) {
      result[reason] += count.get<std::int64_t>();
    }
  }
  return result;
}

std::string clean_log() {
  FourPrograms run("practical_rigid.yaml");
  run.settings = settings();
  run.start_all();
  run.expect_all_done();
  return contents(run.log_path());
}

TEST(HostileTraffic, OfAMillionDatagramsChangesNothing) {
  const std::string clean = clean_log();
  ASSERT_FALSE(clean.empty());

  constexpr std::int64_t datagrams = 1'000'000;
  constexpr std::int64_t longest_burst = 3'000;  // some overflow the receivers' buffers
  FourPrograms run("practical_rigid.yaml");
  run.settings = settings();
  bus::UdpTransport bus;
  bus.subscribe_all();
  HostileTraffic traffic(run_id);
  run.start_all();

  const bus::Codec<loop::Tick> codec(loop::Layout{});
  loop::Stamp stamp;
  loop::Tick tick;
  const auto listen = [&](loop::Clock::time_point deadline) {
    const auto datagram = bus.receive(deadline);
    if (!datagram || traffic.is(datagram->sender)) return datagram.has_value();
    traffic.add_sample(datagram->channel, datagram->payload);
    if (datagram->channel == "ARM_TICK" &&
        codec.decode(datagram->payload, stamp, tick) == bus::Rejection::none) {
      traffic.now_at(stamp.tick);
    }
    return true;
  };
  while (stamp.tick < 500) {  // all have touched the memory they need
    ASSERT_TRUE(listen(loop::Clock::now() + std::chrono::seconds(10))) << run["plant"].errors();
  }
  const auto before = memory(run);
  while (traffic.sent() < datagrams) {
    traffic.send(std::min(longest_burst, datagrams - traffic.sent()));
    while (listen(loop::Clock::time_point::min())) continue;
    // Spread over the run, so that the run outlasts it.
    const auto deadline = loop::Clock::now() + std::chrono::milliseconds(100);
    while (traffic.sent() > datagrams / 50'000 * stamp.tick && loop::Clock::now() < deadline) {
      listen(deadline);
    }
  }
  const auto after = memory(run);
  EXPECT_FALSE(tick.last) << "the run has ended before the hostile datagrams";
  run.expect_all_done();
  EXPECT_EQ(traffic.sent(), datagrams);
  EXPECT_TRUE(contents(run.log_path()) == clean);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // (A sanitizer holds back what is freed.)
  for (const char* role : roles) {
    EXPECT_LE(after.at(role) - before.at(role), 1024)
        << role << ": KiB more than before the hostile datagrams";
  }
#endif
  for (const auto& [reason, count] : rejected(run)) {
    if (reason == "unauthenticated") continue;  // a bus without a key
    EXPECT_GT(count, 0) << reason;
  }
}

/// Two complete systems at the same time, each with these options; both must end well.
void run_two(FourPrograms& first, const std::vector<std::string>& first_options,
             FourPrograms& second, const std::vector<std::string>& second_options) {
  for (const char* role : roles) {
    first.start(role, first_options);
    second.start(role, second_options);
  }
  first.expect_all_done();
  second.expect_all_done();
}

std::vector<std::string> bus_at(const std::string& address) {
  return {"--lcm-url", "udpm://" + address + "?ttl=0"};
}

TEST(TwoSystemsOnOneMachine, DoNotDisturbEachOtherOnTwoPortsOrInTwoGroups) {
  const auto log_alone = [] {
    FourPrograms alone("practical_rigid.yaml");
    alone.settings = {"--set", "loop.duration_s=1"};
    alone.start_all();
    alone.expect_all_done();
    return contents(alone.log_path());
  }();
  ASSERT_FALSE(log_alone.empty());
  for (const char* other : {"239.255.76.67:7668", "239.255.76.68:7667"}) {
    // The same robot, and even the same run.
    FourPrograms first("practical_rigid.yaml");
    FourPrograms second("practical_rigid.yaml");
    first.settings = second.settings = {"--set", "loop.duration_s=1"};
    run_two(first, bus_at("239.255.76.67:7667"), second, bus_at(other));
    for (FourPrograms* each : {&first, &second}) {
      EXPECT_TRUE(contents(each->log_path()) == log_alone) << other;
      EXPECT_EQ(rejected(*each).at("other_run"), 0) << other;
    }
  }
}

TEST(TwoSystemsOnOneMachine, DoNotDisturbEachOtherOnOneBusWhenTheirRobotsHaveTwoNames) {
  FourPrograms left("practical_rigid.yaml", {"--run-id", "7"});
  FourPrograms right("practical_rigid.yaml", {"--run-id", "8"});
  left.settings = {"--set", "loop.duration_s=1", "--set", "robot.name=left"};
  right.settings = {"--set", "loop.duration_s=1", "--set", "robot.name=right"};
  run_two(left, {}, right, {});
  for (FourPrograms* each : {&left, &right}) {
    EXPECT_EQ(rejected(*each).at("other_run"), 0);
  }
  FourPrograms alone("practical_rigid.yaml", {"--run-id", "7"});
  alone.settings = left.settings;
  alone.start_all();
  alone.expect_all_done();
  EXPECT_TRUE(contents(left.log_path()) == contents(alone.log_path()));
}

TEST(TwoSystemsOnOneMachine, AreRefusedTheSecondOfOneRobotAndLeaveTheFirstAlone) {
  FourPrograms first("practical_rigid.yaml", {"--run-id", "7"});
  FourPrograms second("practical_rigid.yaml", {"--run-id", "8"});
  first.settings = second.settings = {"--set", "loop.duration_s=60"};
  bus::UdpTransport bus;
  bus.subscribe("ARM_COMMAND");
  first.start_all();
  ASSERT_TRUE(bus.receive(loop::Clock::now() + std::chrono::seconds(30)));
  second.start_all();
  for (const char* role : roles) {
    EXPECT_EQ(second[role].wait(), 4) << role;
    EXPECT_THAT(second[role].errors(), HasSubstr("there is already the " + std::string(role)));
  }
  first.expect_all_done();
}

}  // namespace
