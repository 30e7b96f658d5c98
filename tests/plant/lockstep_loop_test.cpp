// The plant in lockstep against a controller and a logger that answer as a test wants it: the
// messages of a tick, their repeats, and the end of a run with a silent peer.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "tests/plant/peers.h"

namespace tachless::plant {
namespace {

using base::ExitCode;
using messages::truth::DriveFault;
using testing::HasSubstr;

constexpr std::int64_t num_ticks = 30;

/// Peers answer the plant's announcements, some ten a second: they are silent in between.
scenario::Scenario lockstep(const std::vector<std::string>& overrides = {}) {
  std::vector<std::string> all = {"loop.mode=lockstep", "loop.give_up_s=0.5"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return scenario(all);
}

std::vector<std::int64_t> all_ticks() {
  std::vector<std::int64_t> ticks(num_ticks);
  std::iota(ticks.begin(), ticks.end(), 0);
  return ticks;
}

/// The torques that the plant applies when no command is lost.
void expect_torques_of_the_ticks(const Peers& peers, std::int64_t delay) {
  ASSERT_EQ(peers.truth_ticks, all_ticks());
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    const auto& truth = peers.truths[static_cast<std::size_t>(k)];
    EXPECT_EQ(truth.tau, k < delay ? Vector(Vector::Zero(2)) : torque_of(k - delay)) << k;
    EXPECT_EQ(truth.fault, DriveFault::none) << k;
  }
}

TEST(LockstepLoop, AppliesTheCommandOfEachTickAfterTheDelay) {
  for (const std::int64_t delay : {0, 1, 2}) {
    SCOPED_TRACE(delay);
    const scenario::Scenario s = lockstep({"loop.command_delay=" + std::to_string(delay)});
    Peers peers(s);
    peers.on_truth = [&](std::int64_t k) { peers.acknowledge(k); };
    const Outcome outcome = run(s, peers);
    ASSERT_EQ(outcome.fault, "");
    expect_torques_of_the_ticks(peers, delay);
    EXPECT_EQ(outcome.statistics.plant().round_trip_us.count(), num_ticks);
    EXPECT_EQ(outcome.statistics.ticks, num_ticks);
  }
}

TEST(LockstepLoop, RepeatsTheRequestOfALostCommandAndMovesTheArmOnce) {
  const scenario::Scenario s = lockstep();
  Peers peers(s);
  int lost = 0;
  peers.on_measurement = [&](std::int64_t k) {
    if (k == 5 && ++lost <= 2) return;
    peers.command(k, torque_of(k));
  };
  peers.on_truth = [&](std::int64_t k) { peers.acknowledge(k); };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_GE(std::ranges::count(peers.ticks, 5), 3);  // two requests were not answered
  EXPECT_GE(outcome.statistics.resends, 4);          // TICK and measurement, twice
  expect_torques_of_the_ticks(peers, 1);
}

/// The logger loses the first TRUTH of tick 4.
TEST(LockstepLoop, RepeatsAllMessagesOfATickThatTheLoggerMisses) {
  const scenario::Scenario s = lockstep();
  Peers peers(s);
  bool is_lost = false, is_missing = false;
  std::int64_t newest = -1;
  peers.on_truth = [&](std::int64_t k) {
    newest = std::max(newest, k);
    if (k == 4) is_missing = !std::exchange(is_lost, true);
    // Bit 0 is the tick after the last one without a gap.
    peers.acknowledge(is_missing ? 3 : newest, is_missing ? 1 : 0);
  };
  const Outcome outcome = run(s, peers);
  ASSERT_EQ(outcome.fault, "");
  std::vector<messages::truth::PlantTruth> of_4;
  for (std::size_t i = 0; i < peers.truth_ticks.size(); ++i) {
    if (peers.truth_ticks[i] == 4) of_4.push_back(peers.truths[i]);
  }
  ASSERT_GE(of_4.size(), 2U);
  EXPECT_EQ(of_4[0].tau, of_4[1].tau);
  EXPECT_EQ(of_4[0].q, of_4[1].q);
  EXPECT_GE(std::ranges::count(peers.ticks, 4), 2);
}

TEST(LockstepLoop, EndsWithTheNameOfThePeerThatDoesNotAnswer) {
  const scenario::Scenario s = lockstep();
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    if (k < 5) peers.command(k, torque_of(k));
  };
  peers.on_truth = [&](std::int64_t k) { peers.acknowledge(k); };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::peer_lost);
  EXPECT_THAT(outcome.fault, HasSubstr("no command for tick 5 for 0.5 s: no answer from"));
  EXPECT_EQ(peers.truths.size(), 5U);
}

TEST(LockstepLoop, EndsWhenTheLoggerRecordsNoMore) {
  const scenario::Scenario s = lockstep();
  Peers peers(s);
  peers.on_truth = [&](std::int64_t k) {
    if (k < 10) peers.acknowledge(k);
  };
  const Outcome outcome = run(s, peers);
  EXPECT_EQ(outcome.code, ExitCode::peer_lost);
  EXPECT_THAT(outcome.fault, HasSubstr("tick 10 is not recorded for 0.5 s"));
  EXPECT_THAT(outcome.fault, HasSubstr("the logger"));
}

}  // namespace
}  // namespace tachless::plant
