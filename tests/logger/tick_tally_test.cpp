#include "logger/tick_tally.h"

#include <gtest/gtest.h>

#include <cstring>

#include "tests/core/session/bytes_of.h"

namespace tachless::logger {
namespace {

using messages::num_slots;
using session::Receipt;
using Slot = TickTally::Slot;

void record_all(TickTally& tally, std::int64_t tick) {
  for (int slot = 0; slot < num_slots; ++slot) {
    EXPECT_EQ(tally.on_message(static_cast<Slot>(slot), tick, BytesOf(1)), Receipt::fresh);
  }
}

TEST(TickTally, CountsWholeTicks) {
  TickTally tally(5000);
  for (std::int64_t k = 0; k < 5000; ++k) record_all(tally, k);
  tally.finish(4999);
  EXPECT_EQ(tally.num_complete(), 5000);
  EXPECT_EQ(tally.num_incomplete(), 0);
  EXPECT_EQ(tally.newest(), 4999);
}

TEST(TickTally, MissesTheContactOfARunThatHasIt) {
  for (const bool contact : {false, true}) {
    TickTally tally(10, contact);
    for (std::int64_t k = 0; k < 10; ++k) {
      for (const Slot slot : messages::all_slots) {
        if (slot != Slot::contact) tally.on_message(slot, k, BytesOf(1));
      }
    }
    tally.finish(9);
    EXPECT_EQ(tally.num_complete(), contact ? 0 : 10);
    EXPECT_EQ(tally.missing(Slot::contact).count, contact ? 10U : 0U);
  }
}

TEST(TickTally, MissesNoTorqueThatAnArmMayNotTell) {
  TickTally tally(10);
  for (std::int64_t k = 0; k < 10; ++k) {
    for (const Slot slot : messages::all_slots) {
      if (slot != Slot::arm_torque) tally.on_message(slot, k, BytesOf(1));
    }
  }
  tally.finish(9);
  EXPECT_EQ(tally.num_complete(), 10);
}

TEST(TickTally, NamesWhatIsMissing) {
  TickTally tally(3000);
  for (std::int64_t k = 0; k < 3000; ++k) {
    for (int slot = 0; slot < num_slots; ++slot) {
      if (static_cast<Slot>(slot) == Slot::command && ((k >= 40 && k <= 55) || k == 12)) continue;
      if (static_cast<Slot>(slot) == Slot::truth && k == 2999) continue;
      tally.on_message(static_cast<Slot>(slot), k, BytesOf(1));
    }
  }
  tally.finish(2999);
  EXPECT_EQ(tally.missing(Slot::command).count, 17U);
  EXPECT_EQ(tally.missing(Slot::command).text(), "12, 40-55");
  EXPECT_EQ(tally.missing(Slot::truth).text(), "2999");
  EXPECT_EQ(tally.missing(Slot::tick).count, 0U);
  EXPECT_EQ(tally.num_incomplete(), 18);
  EXPECT_EQ(tally.num_complete(), 3000 - 18);
}

TEST(TickTally, CountsTicksOfWhichThereIsNothingAtAll) {
  TickTally tally(10000);
  record_all(tally, 0);
  record_all(tally, 5000);
  tally.finish(9999);
  EXPECT_EQ(tally.num_complete(), 2);
  EXPECT_EQ(tally.num_incomplete(), 9998);
  EXPECT_EQ(tally.missing(Slot::tick).text(), "1-4999, 5001-9999");
}

TEST(TickTally, MissesNoAnswersInAProtectiveStop) {
  TickTally tally(3000);
  for (std::int64_t k = 0; k < 2500; ++k) {
    for (const Slot slot : messages::all_slots) {
      if (!is_due_while_stopped(slot) && k >= 1990) continue;
      tally.on_message(slot, k, BytesOf(1));
    }
    if (k >= 2000) tally.on_stop(k);
  }
  tally.finish(tally.newest());
  EXPECT_EQ(tally.missing(Slot::command).text(), "1990-1999");
  EXPECT_EQ(tally.missing(Slot::reference).text(), "1990-1999");
  EXPECT_EQ(tally.num_incomplete(), 10);
  EXPECT_EQ(tally.num_complete(), 2490);
}

TEST(TickTally, CountsNoTickAfterTheStopAsIncomplete) {
  TickTally tally(3000);
  for (std::int64_t k = 0; k < 2000; ++k) {
    if (k == 700) continue;
    if (k < 1500) {
      record_all(tally, k);
    } else {  // the controller has ended; the plant brings the robot to rest
      tally.on_message(Slot::tick, k, BytesOf(1));
    }
    if (k == 1501) tally.stop_after(1500);
    if (k == 1800) tally.stop_after(1800);  // another one ends
  }
  tally.finish(tally.newest());
  EXPECT_EQ(tally.num_complete(), 1499);
  EXPECT_EQ(tally.num_incomplete(), 2);
  EXPECT_EQ(tally.missing(Slot::command).text(), "700, 1500");
}

TEST(TickTally, ListsTheFirstRangesAndCountsTheRest) {
  TickTally tally(100);
  for (std::int64_t k = 0; k < 100; k += 2) record_all(tally, k);
  tally.finish(99);
  EXPECT_EQ(tally.missing(Slot::tick).text(), "1, 3, 5, 7, 9 and 45 more");
}

TEST(TickTally, TakesMessagesOutOfOrderWithinItsWindow) {
  TickTally tally(5000);
  record_all(tally, 1500);
  EXPECT_EQ(tally.on_message(Slot::tick, 1500 - TickTally::window, BytesOf(1)), Receipt::too_old);
  EXPECT_EQ(tally.on_message(Slot::tick, 1501 - TickTally::window, BytesOf(1)), Receipt::fresh);
}

TEST(TickTally, TellsCopiesAndContradictions) {
  TickTally tally(5000);
  record_all(tally, 7);
  EXPECT_EQ(tally.on_message(Slot::command, 7, BytesOf(1)), Receipt::repeated);
  EXPECT_EQ(tally.on_message(Slot::command, 7, BytesOf(2)), Receipt::conflicting);
  EXPECT_EQ(tally.on_message(Slot::command, -1, BytesOf(1)), Receipt::not_asked);
  EXPECT_EQ(tally.on_message(Slot::command, 5000, BytesOf(1)), Receipt::not_asked);
}

TEST(TickTally, AReferenceAheadIsNoTickYet) {
  TickTally tally(10);
  tally.on_message(Slot::reference, 1, BytesOf(1));
  EXPECT_EQ(tally.newest(), -1);
}

}  // namespace
}  // namespace tachless::logger
