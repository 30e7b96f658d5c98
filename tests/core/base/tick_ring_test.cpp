#include "base/tick_ring.h"

#include <gtest/gtest.h>

namespace tachless::base {
namespace {

TEST(TickRing, KeepsTheLastTicks) {
  TickRing<int> ring(3, -1);
  EXPECT_EQ(ring.size(), 3);
  for (int tick = 0; tick < 5; ++tick) ring[tick] = 10 * tick;
  const TickRing<int>& kept = ring;
  EXPECT_EQ(kept[4], 40);
  EXPECT_EQ(kept[3], 30);
  EXPECT_EQ(kept[2], 20);
  EXPECT_EQ(kept[1], 40) << "tick 4 has taken its place";
}

TEST(TickRing, IsFilledWithOneValue) {
  TickRing<int> ring(2);
  EXPECT_EQ(ring[1], 0);
  ring.fill(7);
  EXPECT_EQ(ring[0], 7);
  EXPECT_EQ(ring[5'000'000'001], 7);
}

}  // namespace
}  // namespace tachless::base
