// These tests start the four programs as a user does, on the real bus in a network of their own.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/udp_transport.h"
#include "messages/wire.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/system/four_programs.h"

namespace tachless::by_hand_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

using system_test::FourPrograms;
using system_test::roles;
using system_test::scenarios;

/// Waits for an announcement of this role: the program is up and waits for the others.
void hear(bus::Transport& bus, const std::string& role) {
  const messages::Codec<messages::Participant> codec(messages::Layout{});
  messages::Stamp stamp;
  messages::Participant participant;
  const auto deadline = base::Clock::now() + std::chrono::seconds(30);
  while (const auto datagram = bus.receive(deadline)) {
    if (codec.decode(datagram->payload, stamp, participant) == messages::Rejection::none &&
        messages::name(participant.role) == role) {
      return;
    }
  }
  throw std::runtime_error("no " + role + " heard in 30 s");
}

TEST(ByHand, AnyOfThe24OrdersOfStartingWorksAndGivesTheSameLog) {
  std::vector<std::string> order(roles.begin(), roles.end());
  std::sort(order.begin(), order.end());
  std::string first;
  int orders = 0;
  do {
    FourPrograms run("paper_rigid.yaml");
    for (const std::string& role : order) {
      // Each program is up and waits before the next one starts, so the order is certain.
      bus::UdpTransport bus;
      bus.subscribe("ARM_PARTICIPANT");
      run.start(role);
      hear(bus, role);
    }
    run.expect_all_done();
    const std::string log = contents(run.log_path());
    ASSERT_FALSE(log.empty());
    if (first.empty()) first = log;
    EXPECT_TRUE(log == first) << "order " << orders;
    ++orders;
  } while (std::next_permutation(order.begin(), order.end()));
  EXPECT_EQ(orders, 24);
}

/// Runs the programs with these options, and returns the stderr of each.
std::map<std::string, std::string> errors_with(const std::vector<std::string>& options) {
  FourPrograms run("paper_rigid.yaml");
  run.settings.insert(run.settings.end(), options.begin(), options.end());
  run.start_all();
  run.expect_all_done();
  std::map<std::string, std::string> errors;
  for (const std::string role : roles) errors[role] = run[role].errors();
  return errors;
}

TEST(ByHand, VerboseSaysWhatEachProgramWorksWith) {
  const auto normal = errors_with({});
  const auto verbose = errors_with({"--verbose"});
  const std::map<std::string, std::vector<std::string>> expected = {
      {"plant",
       {"receives ARM_COMMAND\n", "mechanics simbody, integrated with accuracy ",
        "the law measures POSITION\n"}},
      {"reference", {"receives ARM_TICK\n"}},
      {"controller",
       {"receives ARM_POSITION\n",
        "law loria_ortega_rigid, measures POSITION, publishes its signals error:rad,nu:rad/s\n"}},
      {"logger", {"receives ARM_TRUTH\n", "writes the log /"}}};
  for (const auto& [role, lines] : expected) {
    const std::string& more = verbose.at(role);
    EXPECT_THAT(more, AllOf(HasSubstr("bus udpm://"), HasSubstr("?ttl=0, receive buffer "),
                            HasSubstr("no --key-file\n"), HasSubstr("run 7 on ARM_PARTICIPANT, ")))
        << role;
    for (const std::string& line : lines) {
      EXPECT_THAT(more, HasSubstr(line)) << role;
      EXPECT_THAT(normal.at(role), Not(HasSubstr(line))) << role;
    }
    // Each line appears once, and not in each of the 400 ticks.
    EXPECT_LT(std::count(more.begin(), more.end(), '\n'), 25) << role;
  }
}

TEST(ByHand, RefusesASecondControllerAndFinishesWithTheFirst) {
  FourPrograms run("paper_rigid.yaml");
  run.settings = {"--set", "loop.duration_s=0.5"};
  run.start("controller").wait_for("waiting for");
  Program second("tachless-controller",
                 {scenarios + "paper_rigid.yaml", "--set", "loop.duration_s=0.5"},
                 run.directory().path());
  EXPECT_EQ(second.wait(), 4);
  EXPECT_THAT(second.errors(), HasSubstr("controller"));
  for (const char* role : {"logger", "reference", "plant"}) run.start(role);
  run.expect_all_done();
}

TEST(ByHand, PlantAndControllerWithDifferentScenariosRefuseEachOther) {
  FourPrograms run("paper_rigid.yaml");
  run.start("plant").wait_for("waiting for");
  Program other("tachless-controller", {scenarios + "paper_rigid_offset.yaml", "--wait-s", "30"},
                run.directory().path());
  EXPECT_EQ(other.wait(), 2);
  EXPECT_EQ(run["plant"].wait(), 2);
  for (const std::string& errors : std::vector{other.errors(), run["plant"].errors()}) {
    EXPECT_THAT(errors, AllOf(HasSubstr("paper_rigid"), HasSubstr("paper_rigid_offset")));
  }
}

TEST(ByHand, InterruptedControllerEndsTheRunAndTheLogStaysReadable) {
  FourPrograms run("paper_rigid.yaml");
  run.settings = {"--set", "loop.duration_s=200"};
  run.start_all();
  // A part of the run must be on disk before it is interrupted.
  while (run.log_size() < 100000) {
    ASSERT_EQ(run["plant"].errors().find("lost"), std::string::npos) << run["plant"].errors();
  }
  run["controller"].signal(SIGINT);
  EXPECT_EQ(run["controller"].wait(), 130);
  EXPECT_THAT(run["controller"].errors(), HasSubstr("interrupted"));
  for (const char* role : {"plant", "reference", "logger"}) {
    EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
    EXPECT_THAT(run[role].errors(), AllOf(HasSubstr("controller"), HasSubstr("interrupted")));
  }
  EXPECT_GT(run.log_size(), 100000U);
}

}  // namespace
}  // namespace tachless::by_hand_test
