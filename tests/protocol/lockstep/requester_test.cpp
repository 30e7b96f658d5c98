#include "protocol/lockstep/requester.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::lockstep {
namespace {

using namespace std::chrono_literals;
using What = Requester::Repeat::What;

class ARequester : public testing::Test {
 protected:
  static constexpr std::int64_t num_ticks = 200;

  static Requester::Config config() {
    Requester::Config result;
    result.num_ticks = num_ticks;
    return result;
  }
  void introduce() {
    requester.introduced(now);
    requester.on_ack(-1, 0, now);
  }
  void run_one() {
    requester.asked(now);
    requester.on_command(requester.next_tick(), BytesOf(requester.next_tick()), "controller", now);
    requester.completed(now);
  }
  std::vector<std::int64_t> repeated_ticks() {
    std::vector<std::int64_t> result;
    while (const auto repeat = requester.next_repeat(now)) {
      EXPECT_EQ(repeat->what, What::all);
      result.push_back(repeat->tick);
    }
    return result;
  }
  using Ticks = std::vector<std::int64_t>;

  loop::Clock::time_point now{1s};
  Requester requester{config(), 8};
};

TEST_F(ARequester, BeginsWhenTheLoggerHasRunInfo) {
  EXPECT_FALSE(requester.may_begin());
  requester.introduced(now);
  EXPECT_FALSE(requester.may_begin());
  EXPECT_FALSE(requester.next_repeat(now));
  now += 2ms;
  EXPECT_EQ(requester.next_repeat(now)->what, What::run_info);
  requester.on_ack(-2, 0, now);
  EXPECT_FALSE(requester.may_begin());
  requester.on_ack(-1, 0, now);
  EXPECT_TRUE(requester.may_begin());
  EXPECT_THROW(requester.completed(now), std::logic_error);
}

TEST_F(ARequester, RepeatsAQuestionEvery2msAndLaterDoublesTo320ms) {
  introduce();
  requester.asked(now);
  std::vector<std::int64_t> waits_ms;
  for (int i = 0; i < 17; ++i) {
    const auto before = now;
    now = requester.deadline();
    const auto repeat = requester.next_repeat(now);
    ASSERT_TRUE(repeat);
    EXPECT_EQ(repeat->what, What::question);
    EXPECT_EQ(repeat->tick, 0);
    EXPECT_FALSE(requester.next_repeat(now));
    waits_ms.push_back((now - before) / 1ms);
  }
  EXPECT_EQ(waits_ms, (Ticks{2, 2, 2, 2, 2, 2, 2, 2, 4, 8, 16, 32, 64, 128, 256, 320, 320}));
}

TEST_F(ARequester, StartsEachTickWithTheFirstTimeout) {
  introduce();
  requester.asked(now);
  now += 2ms;
  EXPECT_TRUE(requester.next_repeat(now));
  requester.on_command(0, BytesOf(0), "controller", now);
  requester.completed(now);
  requester.asked(now);
  EXPECT_EQ(requester.deadline(), now + 2ms);
}

TEST_F(ARequester, LearnsHowLongAnswersTake) {
  introduce();
  const auto tick_that_takes = [&](std::chrono::nanoseconds round_trip) {
    const std::int64_t k = requester.next_tick();
    requester.asked(now);
    const auto patience = requester.deadline() - now;
    now += round_trip;
    requester.next_repeat(now);
    requester.on_command(k, BytesOf(k), "controller", now);
    EXPECT_EQ(requester.round_trip(), round_trip);
    requester.completed(now);
    requester.on_ack(k, 0, now);
    return patience;
  };
  EXPECT_EQ(tick_that_takes(100us), 2ms);
  for (int i = 0; i < 50; ++i) tick_that_takes(100us);
  EXPECT_EQ(tick_that_takes(100us), 500us);
  EXPECT_EQ(tick_that_takes(50ms), 500us);  // repeated: says nothing of the usual time
  EXPECT_EQ(tick_that_takes(100us), 500us);
  for (int i = 0; i < 50; ++i) tick_that_takes(i % 2 ? 300us : 450us);
  const auto patience = tick_that_takes(100us);
  EXPECT_GT(patience, 500us);
  EXPECT_LT(patience, 1ms);
}

TEST_F(ARequester, TakesTheCommandOfTheTickAskedForAndNoOther) {
  introduce();
  EXPECT_EQ(requester.on_command(0, BytesOf(5), "a", now), Verdict::not_asked);
  requester.asked(now);
  EXPECT_EQ(requester.on_command(1, BytesOf(5), "a", now), Verdict::not_asked);
  EXPECT_EQ(requester.on_command(-1, BytesOf(5), "a", now), Verdict::not_asked);
  EXPECT_FALSE(requester.commanded());
  EXPECT_EQ(requester.on_command(0, BytesOf(5), "a", now), Verdict::fresh);
  EXPECT_TRUE(requester.commanded());
  EXPECT_EQ(requester.on_command(0, BytesOf(5), "b", now), Verdict::repeated);
  EXPECT_EQ(requester.on_command(0, BytesOf(6), "b", now), Verdict::conflicting);
  EXPECT_EQ(requester.commander(0), "a");
  requester.completed(now);
  EXPECT_EQ(requester.on_command(0, BytesOf(6), "b", now), Verdict::conflicting);
}

TEST_F(ARequester, NeverRunsMoreThan48TicksAhead) {
  introduce();
  while (requester.may_begin()) run_one();
  EXPECT_EQ(requester.next_tick(), 48);
  EXPECT_EQ(requester.waiting(), Requester::Waiting::logger_for_window);
  EXPECT_THROW(requester.asked(now), std::logic_error);
  requester.on_ack(3, 0, now);
  while (requester.may_begin()) run_one();
  EXPECT_EQ(requester.next_tick(), 52);
}

TEST_F(ARequester, RepeatsExactlyWhatTheLoggerMisses) {
  introduce();
  for (int i = 0; i < 20; ++i) run_one();
  requester.asked(now);
  now += 1ms;
  requester.on_ack(3, 0b1000'0000'0000'0101, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{4, 6, 19}));
  EXPECT_EQ(repeated_ticks(), Ticks{});
}

TEST_F(ARequester, DoesNotRepeatTheTickUnderWayForTheLogger) {
  introduce();
  run_one();
  requester.asked(now);
  now += 1ms;
  requester.on_ack(-1, 0b11, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{0}));
}

TEST_F(ARequester, DoesNotRepeatForTheLoggerWhatWasSentAMomentAgo) {
  introduce();
  for (int i = 0; i < 20; ++i) run_one();
  requester.asked(now);
  now += 999us;
  requester.on_ack(-1, 0b1, now);
  EXPECT_EQ(repeated_ticks(), Ticks{});
  now += 1us;
  requester.on_ack(-1, 0b1, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{0}));
  requester.on_ack(-1, 0b1, now);
  EXPECT_EQ(repeated_ticks(), Ticks{});
}

TEST_F(ARequester, ProbesASilentLoggerWithTheOldestTick) {
  introduce();
  while (requester.may_begin()) run_one();
  now += 1ms;
  requester.on_ack(7, 0, now);
  while (requester.may_begin()) run_one();
  EXPECT_EQ(repeated_ticks(), Ticks{});
  now = requester.deadline();
  EXPECT_EQ(repeated_ticks(), (Ticks{8}));
}

TEST_F(ARequester, RepeatsAllThatIsKnownToBeMissingWhenStalled) {
  introduce();
  while (requester.may_begin()) run_one();
  requester.on_ack(-1, 0b10010, now);
  EXPECT_EQ(repeated_ticks(), Ticks{});
  now = requester.deadline();
  EXPECT_EQ(repeated_ticks(), (Ticks{0, 1, 4}));
}

TEST_F(ARequester, ForgetsARequestOfTheLoggerThatIsFulfilled) {
  introduce();
  for (int i = 0; i < 20; ++i) run_one();
  now += 1ms;
  requester.on_ack(-1, 0b11, now);
  requester.on_ack(0, 0b1, now);
  EXPECT_EQ(repeated_ticks(), (Ticks{1}));
  EXPECT_EQ(requester.on_ack(-1, 0b11, now + 1s), Verdict::too_old);
  EXPECT_EQ(repeated_ticks(), Ticks{});
}

TEST_F(ARequester, RefusesAnAcknowledgementOfTheFuture) {
  introduce();
  run_one();
  EXPECT_EQ(requester.on_ack(1, 0, now), Verdict::not_asked);
  EXPECT_EQ(requester.on_ack(-3, 0, now), Verdict::not_asked);
  EXPECT_EQ(requester.on_ack(0, 0, now), Verdict::fresh);
}

TEST_F(ARequester, EndsWhenTheLastTickIsAcknowledged) {
  introduce();
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    requester.on_ack(k - 1, 0, now);
    run_one();
  }
  EXPECT_FALSE(requester.may_begin());
  EXPECT_FALSE(requester.finished());
  EXPECT_EQ(requester.waiting(), Requester::Waiting::logger_for_end);
  requester.on_ack(num_ticks - 1, 0, now);
  EXPECT_TRUE(requester.finished());
  EXPECT_EQ(requester.waiting(), Requester::Waiting::nobody);
  EXPECT_EQ(requester.deadline(), loop::Clock::time_point::max());
}

TEST_F(ARequester, AsksASuccessorAgainFromWhereItIsUntilItHasCommanded) {
  introduce();
  for (int k = 0; k < 10; ++k) run_one();
  requester.asked(now);
  requester.replaced(now);
  EXPECT_TRUE(requester.catching_up());
  requester.successor_at(6, now);
  std::vector<std::int64_t> asked;
  while (const auto repeat = requester.next_repeat(now)) {
    EXPECT_EQ(repeat->what, What::question);
    asked.push_back(repeat->tick);
  }
  EXPECT_EQ(asked, (Ticks{7, 8, 9, 10}));
  // It has got further; nothing is asked that it has answered.
  now += 1s;
  requester.successor_at(8, now);
  EXPECT_EQ(requester.next_repeat(now)->tick, 9);
  EXPECT_EQ(requester.on_command(9, BytesOf(9), "successor", now), Verdict::repeated);
  EXPECT_EQ(requester.on_command(10, BytesOf(10), "successor", now), Verdict::fresh);
  EXPECT_FALSE(requester.catching_up());
  EXPECT_FALSE(requester.next_repeat(now + 1s)) << "the command is there";
}

TEST_F(ARequester, AsksASuccessorForNothingThatIsNoLongerKept) {
  introduce();
  for (int k = 0; k < 100; ++k) {
    run_one();
    requester.on_ack(k, 0, now);
  }
  requester.asked(now);
  requester.replaced(now);
  requester.successor_at(35, now);  // of 64 messages kept, that of tick 37 is the oldest
  EXPECT_FALSE(requester.next_repeat(now));
  requester.successor_at(36, now);
  EXPECT_EQ(requester.next_repeat(now)->tick, 37);
}

TEST_F(ARequester, IsPatientWithASuccessorThatMakesProgress) {
  introduce();
  requester.asked(now);
  requester.replaced(now);
  for (int i = 0; i < 10; ++i) {
    now += 4s;
    EXPECT_FALSE(requester.given_up(now)) << i;
    requester.successor_at(i, now);
  }
  now += 6s;
  EXPECT_TRUE(requester.given_up(now));
}

TEST_F(ARequester, DoesNotGiveUpBecauseItWasAsleepItself) {
  introduce();
  requester.asked(now);
  requester.next_repeat(now);
  now += 60s;
  requester.next_repeat(now);
  EXPECT_FALSE(requester.given_up(now));
  for (const auto end = now + 5s; now < end; now += 100ms) requester.next_repeat(now);
  EXPECT_TRUE(requester.given_up(now)) << "the peer is silent";
}

TEST_F(ARequester, GivesUpAfter5sWithoutACommand) {
  introduce();
  requester.asked(now);
  requester.on_ack(-1, 0, now + 4s);
  EXPECT_FALSE(requester.given_up(now + 5s - 1ns));
  EXPECT_TRUE(requester.given_up(now + 5s));
  EXPECT_EQ(requester.waiting(), Requester::Waiting::command);
}

TEST_F(ARequester, GivesUpOnALoggerThatMakesNoProgressAndKnowsWhetherItSpeaks) {
  introduce();
  while (requester.may_begin()) run_one();
  EXPECT_TRUE(requester.given_up(now + 5s));
  EXPECT_FALSE(requester.logger_heard());
  requester.on_ack(-1, 0, now + 4s);
  EXPECT_TRUE(requester.given_up(now + 5s));
  EXPECT_TRUE(requester.logger_heard());
}

TEST_F(ARequester, NeedsAWindowThatFitsTheKeptMessages) {
  Requester::Config wide = config();
  wide.window = 63;
  EXPECT_THROW(Requester(wide, 8), std::logic_error);
}

}  // namespace
}  // namespace tachless::protocol::lockstep
