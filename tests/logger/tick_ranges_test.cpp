#include "logger/tick_ranges.h"

#include <gtest/gtest.h>

namespace tachless::logger {
namespace {

TEST(TickRanges, JoinNeighboursAndCountWhatTheyDoNotList) {
  TickRanges<500> ranges;
  for (const std::int64_t tick : {3, 4, 5, 9}) ranges.add(tick);
  ASSERT_EQ(ranges.listed.size(), 2U);
  EXPECT_EQ(ranges.listed[0].first, 3);
  EXPECT_EQ(ranges.listed[0].last, 5);
  for (std::int64_t tick = 20; tick < 20 + 2 * 600; tick += 2) ranges.add(tick);
  EXPECT_EQ(ranges.count, 604U);
  EXPECT_EQ(ranges.listed.size(), 500U);
  EXPECT_TRUE(ranges.cut());
}

TEST(TickRanges, CountRangesThatTheyDoNotListOnceEach) {
  TickRanges<1> ranges;
  ranges.add({1, 2});
  ranges.add({5, 9});
  ranges.add(10);
  EXPECT_EQ(ranges.count, 8U);
  EXPECT_EQ(ranges.text(), "1-2 and 1 more");
}

}  // namespace
}  // namespace tachless::logger
