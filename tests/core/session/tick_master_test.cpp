#include "session/tick_master.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

#include "tests/core/session/bytes_of.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using What = TickMaster::Repeat::What;

class ARequester : public testing::Test {
 protected:
  static constexpr std::int64_t num_ticks = 200;

  static TickMaster::Config config() {
    TickMaster::Config result;
    result.num_ticks = num_ticks;
    return result;
  }
  void run_one() {
    tick_master.on_asked(now);
    tick_master.on_command(tick_master.next_tick(), BytesOf(tick_master.next_tick()), now);
    tick_master.on_completed(now);
  }
  std::vector<std::int64_t> repeated_ticks() {
    std::vector<std::int64_t> result;
    while (const auto repeat = tick_master.next_repeat(now)) {
      EXPECT_EQ(repeat->what, What::all);
      result.push_back(repeat->tick);
    }
    return result;
  }
  using Ticks = std::vector<std::int64_t>;

  base::Clock::time_point now{1s};
  TickMaster tick_master{config()};
};

TEST_F(ARequester, RepeatsARequestEveryMillisecondAndLaterDoublesTo320ms) {
  tick_master.on_asked(now);
  std::vector<std::int64_t> waits_ms;
  for (int i = 0; i < 17; ++i) {
    const auto before = now;
    now = tick_master.deadline();
    const auto repeat = tick_master.next_repeat(now);
    ASSERT_TRUE(repeat);
    EXPECT_EQ(repeat->what, What::request);
    EXPECT_EQ(repeat->tick, 0);
    EXPECT_FALSE(tick_master.next_repeat(now));
    waits_ms.push_back((now - before) / 1ms);
  }
  EXPECT_EQ(waits_ms, (Ticks{1, 1, 1, 1, 1, 1, 1, 1, 2, 4, 8, 16, 32, 64, 128, 256, 320}));
}

TEST_F(ARequester, StartsEachTickWithTheFirstTimeout) {
  tick_master.on_asked(now);
  now += 1ms;
  EXPECT_TRUE(tick_master.next_repeat(now));
  tick_master.on_command(0, BytesOf(0), now);
  EXPECT_EQ(tick_master.round_trip(), 1ms) << "from the first request on";
  tick_master.on_completed(now);
  tick_master.on_asked(now);
  EXPECT_EQ(tick_master.deadline(), now + 1ms);
}

TEST_F(ARequester, TakesTheCommandOfTheTickAskedForAndNoOther) {
  EXPECT_EQ(tick_master.on_command(0, BytesOf(5), now), Receipt::not_asked);
  tick_master.on_asked(now);
  EXPECT_EQ(tick_master.on_command(1, BytesOf(5), now), Receipt::not_asked);
  EXPECT_EQ(tick_master.on_command(-1, BytesOf(5), now), Receipt::not_asked);
  EXPECT_FALSE(tick_master.is_commanded());
  EXPECT_EQ(tick_master.on_command(0, BytesOf(5), now), Receipt::fresh);
  EXPECT_TRUE(tick_master.is_commanded());
  EXPECT_EQ(tick_master.on_command(0, BytesOf(5), now), Receipt::repeated);
  EXPECT_EQ(tick_master.on_command(0, BytesOf(6), now), Receipt::conflicting);
  tick_master.on_completed(now);
  EXPECT_EQ(tick_master.on_command(0, BytesOf(6), now), Receipt::conflicting);
}

TEST_F(ARequester, NeverRunsMoreThan48TicksAhead) {
  while (tick_master.may_begin()) run_one();
  EXPECT_EQ(tick_master.next_tick(), 48);
  EXPECT_EQ(tick_master.waiting(), TickMaster::Waiting::logger_for_window);
  EXPECT_THROW(tick_master.on_asked(now), std::logic_error);
  tick_master.on_ack(3, 0, now);
  while (tick_master.may_begin()) run_one();
  EXPECT_EQ(tick_master.next_tick(), 52);
}

TEST_F(ARequester, RepeatsExactlyWhatTheLoggerMisses) {
  for (int i = 0; i < 20; ++i) run_one();
  tick_master.on_asked(now);
  now += 500us;
  tick_master.on_ack(3, 0b1000'0000'0000'0101, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{4, 6, 19}));
  EXPECT_EQ(repeated_ticks(), Ticks{});
}

TEST_F(ARequester, DoesNotRepeatTheTickUnderWayForTheLogger) {
  run_one();
  tick_master.on_asked(now);
  now += 500us;
  tick_master.on_ack(-1, 0b11, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{0}));
}

TEST_F(ARequester, DoesNotRepeatForTheLoggerWhatWasSentAMomentAgo) {
  for (int i = 0; i < 20; ++i) run_one();
  tick_master.on_asked(now);
  now += 499us;
  tick_master.on_ack(-1, 0b1, now);
  EXPECT_EQ(repeated_ticks(), Ticks{});
  now += 1us;
  tick_master.on_ack(-1, 0b1, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{0}));
  tick_master.on_ack(-1, 0b1, now);
  EXPECT_EQ(repeated_ticks(), Ticks{});
}

TEST_F(ARequester, ProbesASilentLoggerWithTheOldestTick) {
  while (tick_master.may_begin()) run_one();
  now += 1ms;
  tick_master.on_ack(7, 0, now);
  while (tick_master.may_begin()) run_one();
  EXPECT_EQ(repeated_ticks(), Ticks{});
  now = tick_master.deadline();
  EXPECT_EQ(repeated_ticks(), (Ticks{8}));
}

TEST_F(ARequester, RepeatsAllThatIsKnownToBeMissingWhenStalled) {
  while (tick_master.may_begin()) run_one();
  tick_master.on_ack(-1, 0b10010, now);
  EXPECT_EQ(repeated_ticks(), Ticks{});
  now = tick_master.deadline();
  EXPECT_EQ(repeated_ticks(), (Ticks{0, 1, 4}));
}

TEST_F(ARequester, AsksALoggerThatSpeaksAgainSoonAfterLongSilence) {
  while (tick_master.may_begin()) run_one();
  for (int i = 0; i < 14; ++i) {
    now = tick_master.deadline();
    repeated_ticks();
  }
  ASSERT_GT(tick_master.deadline(), now + 100ms);
  tick_master.on_ack(-1, 0, now);
  EXPECT_EQ(tick_master.deadline(), now + 1ms);
}

TEST_F(ARequester, ForgetsARequestOfTheLoggerThatIsFulfilled) {
  for (int i = 0; i < 20; ++i) run_one();
  now += 1ms;
  tick_master.on_ack(-1, 0b11, now);
  tick_master.on_ack(0, 0b1, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{1}));
  EXPECT_EQ(tick_master.on_ack(-1, 0b11, now + 1s), Receipt::too_old);
  EXPECT_EQ(repeated_ticks(), Ticks{});
}

TEST_F(ARequester, RefusesAnAcknowledgementOfTheFuture) {
  run_one();
  EXPECT_EQ(tick_master.on_ack(1, 0, now), Receipt::not_asked);
  EXPECT_EQ(tick_master.on_ack(-2, 0, now), Receipt::not_asked);
  EXPECT_EQ(tick_master.on_ack(0, 0, now), Receipt::fresh);
}

TEST_F(ARequester, EndsWhenTheLastTickIsAcknowledged) {
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    tick_master.on_ack(k - 1, 0, now);
    run_one();
  }
  EXPECT_FALSE(tick_master.may_begin());
  EXPECT_FALSE(tick_master.is_finished());
  EXPECT_EQ(tick_master.waiting(), TickMaster::Waiting::logger_for_end);
  tick_master.on_ack(num_ticks - 1, 0, now);
  EXPECT_TRUE(tick_master.is_finished());
  EXPECT_EQ(tick_master.waiting(), TickMaster::Waiting::nothing);
  EXPECT_EQ(tick_master.deadline(), base::Clock::time_point::max());
}

TEST_F(ARequester, DoesNotGiveUpBecauseItWasAsleepItself) {
  tick_master.on_asked(now);
  tick_master.next_repeat(now);
  now += 60s;
  tick_master.next_repeat(now);
  EXPECT_FALSE(tick_master.has_given_up(now));
  for (const auto end = now + 5s; now < end; now += 100ms) tick_master.next_repeat(now);
  EXPECT_TRUE(tick_master.has_given_up(now)) << "the peer is silent";
}

TEST_F(ARequester, GivesUpAfter5sWithoutACommand) {
  tick_master.on_asked(now);
  tick_master.on_ack(-1, 0, now + 4s);
  EXPECT_FALSE(tick_master.has_given_up(now + 5s - 1ns));
  EXPECT_TRUE(tick_master.has_given_up(now + 5s));
  EXPECT_EQ(tick_master.waiting(), TickMaster::Waiting::command);
}

TEST_F(ARequester, GivesUpOnALoggerThatMakesNoProgressAndKnowsWhetherItSpeaks) {
  while (tick_master.may_begin()) run_one();
  EXPECT_TRUE(tick_master.has_given_up(now + 5s));
  EXPECT_FALSE(tick_master.has_heard_logger());
  tick_master.on_ack(-1, 0, now + 4s);
  EXPECT_TRUE(tick_master.has_given_up(now + 5s));
  EXPECT_TRUE(tick_master.has_heard_logger());
}

TEST_F(ARequester, DoesNotGiveUpALoggerThatCatchesUpSlowlyAtTheEnd) {
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    tick_master.on_ack(k - 10, 0, now);
    run_one();
  }
  for (std::int64_t tick = num_ticks - 8; tick < num_ticks; ++tick) {
    now += 4s;
    EXPECT_FALSE(tick_master.has_given_up(now));
    tick_master.on_ack(tick, 0, now);
  }
  EXPECT_TRUE(tick_master.is_finished());
}

TEST_F(ARequester, NeedsAWindowThatFitsTheKeptMessages) {
  TickMaster::Config wide = config();
  wide.window = 63;
  EXPECT_THROW(TickMaster{wide}, std::logic_error);
}

}  // namespace
}  // namespace tachless::session
