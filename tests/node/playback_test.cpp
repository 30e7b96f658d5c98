#include "node/playback.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <optional>
#include <string>

#include "diagnostics/failure.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::Clock;
using ::testing::AllOf;
using ::testing::HasSubstr;

experiment::Scenario ten_ticks() {
  experiment::Scenario scenario;
  scenario.loop.num_ticks = 10;
  scenario.loop.give_up_s = 5;
  return scenario;
}

/// Playbacks are told the time; only `join` and `progressed` look at the clock themselves.
class Playing : public testing::Test {
 protected:
  void join(double wait_s) {
    playback_.emplace(ten_ticks(), Playback::Config{7, wait_s, &interrupted_});
    playback_->join({}, {});
    joined_ = Clock::now();
  }

  /// What `poll` says; empty when it says nothing.
  std::string said_after(std::chrono::nanoseconds passed, ExitCode code = ExitCode::peer_lost) {
    try {
      playback_->poll(joined_ + passed);
    } catch (const Failure& failure) {
      EXPECT_EQ(failure.code(), code);
      return failure.what();
    }
    return {};
  }

  std::atomic<bool> interrupted_{false};
  std::optional<Playback> playback_;
  Clock::time_point joined_;
};

TEST_F(Playing, IsOverWithTheRunsLastTick) {
  join(0);
  EXPECT_EQ(playback_->run(), 7);
  EXPECT_FALSE(playback_->finished());
  playback_->progressed(8, 0);
  EXPECT_FALSE(playback_->finished());
  playback_->progressed(9, 0);
  EXPECT_TRUE(playback_->finished());
}

TEST_F(Playing, WaitsForTheFirstMessageAsLongAsItIsTold) {
  join(20);
  EXPECT_EQ(said_after(19s), "") << "longer than give_up_s, which is for a run that has begun";
  EXPECT_THAT(said_after(20s), AllOf(HasSubstr("run 7"), HasSubstr("tachless info LOG")));
  join(0);
  EXPECT_EQ(said_after(24h), "") << "0 is unlimited";
}

TEST_F(Playing, NamesTheTickAfterWhichTheRunStops) {
  join(0);
  playback_->progressed(3, 0);
  joined_ = Clock::now();
  EXPECT_EQ(said_after(4s), "");
  EXPECT_THAT(said_after(5s), HasSubstr("silent after tick 3 of 9"));
}

TEST_F(Playing, EndsWhenInterrupted) {
  join(0);
  interrupted_ = true;
  EXPECT_NE(said_after(0s, ExitCode::interrupted), "");
}

TEST_F(Playing, TakesNoMessageForItsOwn) {
  join(0);
  EXPECT_FALSE(playback_->handle({"ARM_PARTICIPANT", {}, "somebody"}));
  EXPECT_FALSE(playback_->knows("somebody"));
}

}  // namespace
}  // namespace tachless::node
