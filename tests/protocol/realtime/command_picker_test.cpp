#include "protocol/realtime/command_picker.h"

#include <gtest/gtest.h>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::realtime {
namespace {

using lockstep::Verdict;

class Picking : public testing::Test {
 protected:
  Verdict measure(std::int64_t tick, std::uint64_t content = 1) {
    return picker_.on_measurement(tick, BytesOf(content), "plant");
  }
  Verdict refer(std::int64_t tick, std::uint64_t content = 1) {
    return picker_.on_reference(tick, BytesOf(content), "reference");
  }
  std::int64_t due() { return picker_.due().value_or(-1); }

  CommandPicker picker_{1000, 16, 16};
};

TEST_F(Picking, ActsWhenBothAreThere) {
  EXPECT_EQ(measure(0), Verdict::fresh);
  EXPECT_EQ(due(), -1);
  EXPECT_EQ(refer(0), Verdict::fresh);
  EXPECT_EQ(due(), 0);
  picker_.acted(0);
  EXPECT_EQ(due(), -1);
  refer(1);
  EXPECT_EQ(due(), -1);
  measure(1);
  EXPECT_EQ(due(), 1);
}

TEST_F(Picking, PassesOverWhatIsLost) {
  refer(0), measure(0), picker_.acted(0);
  refer(1);    // its measurement is lost
  measure(2);  // its reference is lost
  refer(3), measure(3);
  EXPECT_EQ(due(), 3);
  picker_.acted(3);
  EXPECT_EQ(measure(1), Verdict::too_old) << "no tick is returned to";
  EXPECT_EQ(due(), -1);
}

TEST_F(Picking, TakesTheNewestWhoseReferenceIsThere) {
  measure(4), measure(5), measure(6);
  refer(4), refer(5);
  EXPECT_EQ(due(), 5);
  picker_.acted(5);
  refer(6);
  EXPECT_EQ(due(), 6);
}

TEST_F(Picking, GoesOnAfterAGapLongerThanItsMemory) {
  refer(0), measure(0), picker_.acted(0);
  refer(501), measure(500), measure(501);
  EXPECT_EQ(due(), 501);
}

TEST_F(Picking, ActsOnTheOldestTickThatIsKept) {
  refer(2), measure(2);
  // The memory is 64 ticks; reference 65 takes the place of tick 1.
  measure(64), refer(65);
  EXPECT_EQ(due(), 2);
}

TEST_F(Picking, ActsOnNothingOlderThanItsMemoryThoughItsPlaceIsNotTaken) {
  refer(2), measure(2);
  measure(67);  // 66, whose place is that of 2, was lost
  EXPECT_EQ(due(), -1);
}

TEST_F(Picking, TellsCopiesContradictionsAndStrangers) {
  measure(0), refer(0);
  EXPECT_EQ(measure(0), Verdict::repeated);
  EXPECT_EQ(measure(0, 9), Verdict::conflicting);
  EXPECT_EQ(refer(0, 9), Verdict::conflicting);
  EXPECT_EQ(picker_.sender_of(CommandPicker::Input::measurement, 0), "plant");
  EXPECT_EQ(picker_.sender_of(CommandPicker::Input::reference, 0), "reference");
  EXPECT_EQ(measure(1000), Verdict::not_asked);
  EXPECT_EQ(measure(-1), Verdict::not_asked);
  EXPECT_EQ(refer(1000), Verdict::not_asked);
}

TEST_F(Picking, NeverActsOnATickTwice) {
  measure(3), refer(3), picker_.acted(3);
  EXPECT_THROW(picker_.acted(3), std::logic_error);
}

}  // namespace
}  // namespace tachless::protocol::realtime
