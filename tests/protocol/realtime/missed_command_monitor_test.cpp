#include "protocol/realtime/missed_command_monitor.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::realtime {
namespace {

using lockstep::Verdict;

TEST(MissedCommandMonitor, TakesTheCommandOfThePresentTickOnce) {
  MissedCommandMonitor watch(20, 16);
  watch.begin(0);
  EXPECT_FALSE(watch.commanded());
  EXPECT_EQ(watch.on_command(0, BytesOf(1), "here"), Verdict::fresh);
  EXPECT_TRUE(watch.commanded());
  EXPECT_EQ(watch.on_command(0, BytesOf(1), "here"), Verdict::repeated);
  watch.end();
  EXPECT_EQ(watch.missed(), 0);
  EXPECT_EQ(watch.longest_miss(), 0);
}

TEST(MissedCommandMonitor, TellsLateFromNotAsked) {
  MissedCommandMonitor watch(20, 16);
  watch.begin(5);
  EXPECT_EQ(watch.on_command(6, BytesOf(1), "here"), Verdict::not_asked);
  EXPECT_EQ(watch.on_command(4, BytesOf(1), "here"), Verdict::too_old);
  EXPECT_EQ(watch.on_command(-1, BytesOf(1), "here"), Verdict::not_asked);
  EXPECT_EQ(watch.on_command(std::numeric_limits<std::int64_t>::max(), BytesOf(1), "here"),
            Verdict::not_asked);
  EXPECT_FALSE(watch.commanded());
}

TEST(MissedCommandMonitor, NoticesASecondCommander) {
  MissedCommandMonitor watch(20, 16);
  watch.begin(5);
  watch.on_command(5, BytesOf(1), "first");
  EXPECT_EQ(watch.on_command(5, BytesOf(2), "second"), Verdict::conflicting);
  EXPECT_EQ(watch.sender_of(5), "first");
  watch.end();
  watch.begin(6);
  EXPECT_EQ(watch.on_command(5, BytesOf(2), "second"), Verdict::conflicting) << "late as well";
}

TEST(MissedCommandMonitor, CallsForTheStopAfterMoreThanMaxMissedInARow) {
  MissedCommandMonitor watch(2, 16);
  for (std::int64_t tick = 0; tick < 10; ++tick) {
    watch.begin(tick);
    if (tick == 3 || tick == 6) watch.on_command(tick, BytesOf(1), "here");
    watch.end();
    // 0-2, 4-5 and 7-9 go without.
    EXPECT_EQ(watch.too_many(), tick == 2 || tick == 9) << tick;
  }
  EXPECT_EQ(watch.missed(), 8);
  EXPECT_EQ(watch.missed_in_a_row(), 3);
  EXPECT_EQ(watch.longest_miss(), 3);
}

TEST(MissedCommandMonitor, WithNoneToleratedStopsAtTheFirst) {
  MissedCommandMonitor watch(0, 16);
  watch.begin(0);
  watch.end();
  EXPECT_TRUE(watch.too_many());
}

}  // namespace
}  // namespace tachless::protocol::realtime
