#include "session/responders.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/core/session/bytes_of.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;

constexpr auto t0 = base::Clock::time_point(1000s);

TEST(Pace, BelievesInTicksThatCanHaveBegun) {
  Pace pace(1e-3);
  EXPECT_TRUE(pace.possible(0, t0));
  EXPECT_TRUE(pace.possible(1000, t0 + 1s));
  EXPECT_TRUE(pace.possible(3, t0 + 1s)) << "an old one can have begun as well";
}

TEST(Pace, ForgivesTheFirstMessageForBeingLate) {
  Pace pace(1e-3);
  EXPECT_TRUE(pace.possible(0, t0));
  EXPECT_TRUE(pace.possible(200, t0));
  EXPECT_FALSE(pace.possible(203, t0));
}

TEST(Pace, DoesNotBelieveInTheFarFuture) {
  Pace pace(1e-3);
  EXPECT_TRUE(pace.possible(7000, t0)) << "it may have joined late";
  EXPECT_FALSE(pace.possible(9000, t0 + 1s));
  EXPECT_FALSE(pace.possible(std::numeric_limits<std::int64_t>::max(), t0 + 1s));
  EXPECT_FALSE(pace.possible(-1, t0 + 1s));
}

TEST(Pace, AllowsTwoTicksMoreThanTheTimeAndTheSlack) {
  Pace pace(0.25);
  EXPECT_TRUE(pace.possible(10, t0));
  const auto two_periods = t0 + 500ms - Pace::slack;
  EXPECT_TRUE(pace.possible(14, two_periods));
  EXPECT_FALSE(pace.possible(14, two_periods - 1ms));
}

TEST(Pace, IsOverWithTheLastTickOrWhenItsTimeHasCome) {
  Pace pace(0.25);
  EXPECT_FALSE(pace.over(-1, 14, t0 + 100s)) << "no tick was shown";
  EXPECT_TRUE(pace.possible(10, t0));
  EXPECT_TRUE(pace.over(14, 14, t0));
  EXPECT_FALSE(pace.over(13, 14, t0 + 999ms));
  EXPECT_TRUE(pace.over(13, 14, t0 + 1s));
}

class Picking : public testing::Test {
 protected:
  Receipt measure(std::int64_t tick, std::uint64_t content = 1) {
    return picker_.on_input(measurement_input, tick, BytesOf(content));
  }
  Receipt refer(std::int64_t tick, std::uint64_t content = 1) {
    return picker_.on_input(reference_input, tick, BytesOf(content));
  }
  std::int64_t due() { return picker_.due().value_or(-1); }

  CommandPicker picker_{1000};
};

TEST_F(Picking, ActsWhenBothAreThere) {
  EXPECT_EQ(measure(0), Receipt::fresh);
  EXPECT_EQ(due(), -1);
  EXPECT_EQ(refer(0), Receipt::fresh);
  EXPECT_EQ(due(), 0);
  picker_.on_acted(0);
  EXPECT_EQ(due(), -1);
  refer(1);
  EXPECT_EQ(due(), -1);
  measure(1);
  EXPECT_EQ(due(), 1);
}

TEST_F(Picking, PassesOverWhatIsLost) {
  refer(0), measure(0), picker_.on_acted(0);
  refer(1);    // the tick's measurement is lost
  measure(2);  // the tick's reference is lost
  refer(3), measure(3);
  EXPECT_EQ(due(), 3);
  picker_.on_acted(3);
  EXPECT_EQ(measure(1), Receipt::too_old) << "no tick is returned to";
  EXPECT_EQ(due(), -1);
}

TEST_F(Picking, TakesTheNewestWhoseReferenceIsThere) {
  measure(4), measure(5), measure(6);
  refer(4), refer(5);
  EXPECT_EQ(due(), 5);
  picker_.on_acted(5);
  refer(6);
  EXPECT_EQ(due(), 6);
}

TEST_F(Picking, GoesOnAfterAGapLongerThanItsMemory) {
  refer(0), measure(0), picker_.on_acted(0);
  refer(501), measure(500), measure(501);
  EXPECT_EQ(due(), 501);
}

TEST_F(Picking, ActsOnTheOldestTickThatIsKept) {
  refer(2), measure(2);
  // The ring keeps 64 ticks; reference 65 replaces tick 1.
  measure(64), refer(65);
  EXPECT_EQ(due(), 2);
}

TEST_F(Picking, ActsOnNothingOlderThanItsMemoryThoughItsPlaceIsNotTaken) {
  refer(2), measure(2);
  measure(67);  // tick 66, which would replace tick 2, was lost
  EXPECT_EQ(due(), -1);
}

TEST_F(Picking, TellsCopiesContradictionsAndStrangers) {
  measure(0), refer(0);
  EXPECT_EQ(measure(0), Receipt::repeated);
  EXPECT_EQ(measure(0, 9), Receipt::conflicting);
  EXPECT_EQ(refer(0, 9), Receipt::conflicting);
  EXPECT_EQ(measure(1000), Receipt::not_asked);
  EXPECT_EQ(measure(-1), Receipt::not_asked);
  EXPECT_EQ(refer(1000), Receipt::not_asked);
}

TEST_F(Picking, NeverActsOnATickTwice) {
  measure(3), refer(3), picker_.on_acted(3);
  EXPECT_THROW(picker_.on_acted(3), std::logic_error);
}

TEST(MissedCommandMonitor, TakesTheCommandOfThePresentTickOnce) {
  MissedCommandMonitor watch(20);
  watch.begin(0);
  EXPECT_FALSE(watch.is_commanded());
  EXPECT_EQ(watch.on_command(0, BytesOf(1)), Receipt::fresh);
  EXPECT_TRUE(watch.is_commanded());
  EXPECT_EQ(watch.on_command(0, BytesOf(1)), Receipt::repeated);
  watch.end();
  EXPECT_EQ(watch.missed(), 0);
  EXPECT_EQ(watch.longest_miss(), 0);
}

TEST(MissedCommandMonitor, TellsLateFromNotAsked) {
  MissedCommandMonitor watch(20);
  watch.begin(5);
  EXPECT_EQ(watch.on_command(6, BytesOf(1)), Receipt::not_asked);
  EXPECT_EQ(watch.on_command(4, BytesOf(1)), Receipt::too_old);
  EXPECT_EQ(watch.on_command(-1, BytesOf(1)), Receipt::not_asked);
  EXPECT_EQ(watch.on_command(std::numeric_limits<std::int64_t>::max(), BytesOf(1)),
            Receipt::not_asked);
  EXPECT_FALSE(watch.is_commanded());
}

TEST(MissedCommandMonitor, NoticesASecondCommander) {
  MissedCommandMonitor watch(20);
  watch.begin(5);
  watch.on_command(5, BytesOf(1));
  EXPECT_EQ(watch.on_command(5, BytesOf(2)), Receipt::conflicting);
  watch.end();
  watch.begin(6);
  EXPECT_EQ(watch.on_command(5, BytesOf(2)), Receipt::conflicting) << "late as well";
}

TEST(MissedCommandMonitor, CallsForTheStopAfterMoreThanMaxMissedInARow) {
  MissedCommandMonitor watch(2);
  for (std::int64_t tick = 0; tick < 10; ++tick) {
    watch.begin(tick);
    if (tick == 3 || tick == 6) watch.on_command(tick, BytesOf(1));
    watch.end();
    // Ticks 0-2, 4-5 and 7-9 have no command.
    EXPECT_EQ(watch.has_missed_too_many(), tick == 2 || tick == 9) << tick;
  }
  EXPECT_EQ(watch.missed(), 8);
  EXPECT_EQ(watch.missed_in_a_row(), 3);
  EXPECT_EQ(watch.longest_miss(), 3);
}

TEST(MissedCommandMonitor, WithNoneToleratedStopsAtTheFirst) {
  MissedCommandMonitor watch(0);
  watch.begin(0);
  watch.end();
  EXPECT_TRUE(watch.has_missed_too_many());
}

}  // namespace
}  // namespace tachless::session
