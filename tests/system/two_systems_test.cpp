// Two complete systems on one machine at the same time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_text.h"
#include "bus/udp_transport.h"
#include "tests/support/private_network.h"
#include "tests/system/four_programs.h"

namespace tachless::two_systems_test {
namespace {

using system_test::FourPrograms;
using system_test::roles;
using ::testing::HasSubstr;

/// Dropped messages by reason, of all four.
std::map<std::string, std::int64_t> rejected(const FourPrograms& run) {
  std::map<std::string, std::int64_t> result;
  for (const char* role : roles) {
    const auto json = base::parse_json(contents(run.statistics_path(role)));
    for (const auto& [reason, count] : json.at("rejected").items()) {
      result[reason] += count.get<std::int64_t>();
    }
  }
  return result;
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
  first.settings = second.settings = {"--set", "loop.duration_s=15"};
  bus::UdpTransport bus;
  bus.subscribe("ARM_COMMAND");
  first.start_all();
  ASSERT_TRUE(bus.receive(base::Clock::now() + std::chrono::seconds(30)));
  second.start_all();
  for (const char* role : roles) {
    EXPECT_EQ(second[role].wait(), 4) << role;
    EXPECT_THAT(second[role].errors(), HasSubstr("there is already the " + std::string(role)));
  }
  first.expect_all_done();
}

}  // namespace
}  // namespace tachless::two_systems_test
