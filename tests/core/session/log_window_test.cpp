#include "session/log_window.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <stdexcept>

#include "tests/core/session/bytes_of.h"

namespace tachless::session {
namespace {

class ALogWindow : public testing::Test {
 protected:
  static constexpr std::int64_t num_ticks = 200;

  Receipt put(std::int64_t tick, Slot slot, std::uint64_t content = 0) {
    return window.on_message(slot, tick, BytesOf(content));
  }
  void put_all_but(std::int64_t tick, std::initializer_list<Slot> missing) {
    for (int slot = 0; slot < num_slots; ++slot) {
      bool skip = false;
      for (Slot each : missing) skip = skip || static_cast<int>(each) == slot;
      if (!skip) put(tick, static_cast<Slot>(slot));
    }
  }
  int write() {
    int count = 0;
    while (window.complete_tick()) {
      window.on_written();
      ++count;
    }
    return count;
  }

  LogWindow window{num_ticks, {8, 8, 8, 8, 8, 8}};  // no contact
};

TEST_F(ALogWindow, NeedsAllSixMessagesOfATickInAnyOrder) {
  for (Slot slot : {Slot::truth, Slot::reference, Slot::tick, Slot::command, Slot::measurement}) {
    put(0, slot);
    EXPECT_EQ(window.complete_tick(), std::nullopt);
  }
  put(0, Slot::controller_state);
  EXPECT_EQ(window.complete_tick(), 0);
}

TEST_F(ALogWindow, NeedsTheContactOfARunThatHasIt) {
  window = LogWindow(num_ticks, {8, 8, 8, 8, 8, 8, 8});
  put_all_but(0, {Slot::contact});
  EXPECT_EQ(window.complete_tick(), std::nullopt);
  put(0, Slot::contact);
  EXPECT_EQ(window.complete_tick(), 0);
}

TEST_F(ALogWindow, WritesInOrderOfTicks) {
  put_all_but(1, {});
  EXPECT_EQ(window.complete_tick(), std::nullopt);
  put_all_but(0, {});
  EXPECT_EQ(write(), 2);
  EXPECT_EQ(window.complete_tick(), std::nullopt);
}

TEST_F(ALogWindow, AcknowledgesEvery16TicksOfACleanRunAndTheLast) {
  int acks = 0;
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    put_all_but(k, {});
    write();
    if (const auto ack = window.take_ack()) {
      ++acks;
      EXPECT_TRUE(ack->tick % 16 == 15 || ack->tick == num_ticks - 1) << ack->tick;
      EXPECT_EQ(ack->missing, 0U);
    }
  }
  EXPECT_EQ(acks, 200 / 16 + 1);
}

TEST_F(ALogWindow, AcknowledgesEvery16TicksBehindAGapToo) {
  put_all_but(0, {Slot::command});
  for (std::int64_t k = 1; k < 15; ++k) {
    put_all_but(k, {});
    EXPECT_FALSE(window.take_ack()) << k;
  }
  put_all_but(15, {Slot::truth});
  const auto ack = window.take_ack();
  ASSERT_TRUE(ack);
  EXPECT_EQ(ack->tick, -1);
  EXPECT_EQ(ack->missing, 1U);
}

TEST_F(ALogWindow, CountsTheNewestTwoTicksAsUnderWayUnlessAskedAgain) {
  for (std::int64_t k = 0; k < 16; ++k) put_all_but(k, {Slot::reference});
  EXPECT_EQ(window.take_ack()->missing, 0x3fffU);
  put(15, Slot::truth);
  EXPECT_EQ(window.take_ack()->missing, 0xffffU);
}

TEST_F(ALogWindow, AcknowledgesAtOnceWhenThePlantRepeats) {
  put_all_but(0, {});
  write();
  EXPECT_FALSE(window.take_ack());
  EXPECT_EQ(put(0, Slot::tick), Receipt::repeated);
  EXPECT_FALSE(window.take_ack());
  EXPECT_EQ(put(0, Slot::truth), Receipt::repeated);
  EXPECT_EQ(window.take_ack()->tick, 0);
}

TEST_F(ALogWindow, AcknowledgesAtOnceWhenAGapIsFilled) {
  put_all_but(0, {Slot::command});
  for (std::int64_t k = 1; k < 5; ++k) put_all_but(k, {});
  EXPECT_FALSE(window.take_ack());
  put(0, Slot::command);
  EXPECT_EQ(write(), 5);
  EXPECT_EQ(window.take_ack()->tick, 4);
}

TEST_F(ALogWindow, IgnoresWhatItsWindowCannotHold) {
  EXPECT_EQ(put(64, Slot::tick), Receipt::not_asked);
  EXPECT_EQ(put(-1, Slot::tick), Receipt::not_asked);
  EXPECT_EQ(put(63, Slot::tick), Receipt::fresh);
  for (std::int64_t k = 0; k < 63; ++k) put_all_but(k, {});
  EXPECT_EQ(write(), 63);
}

TEST_F(ALogWindow, SeesAContradiction) {
  put(0, Slot::command, 1);
  EXPECT_EQ(put(0, Slot::command, 2), Receipt::conflicting);
  EXPECT_EQ(number_in(window.bytes(0, Slot::command)), 1U);
}

}  // namespace
}  // namespace tachless::session
