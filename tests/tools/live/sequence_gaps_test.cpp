#include "live/sequence_gaps.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <random>
#include <set>

using namespace tachless;

namespace {

using live::SequenceGaps;

TEST(SequenceGaps, CountsNothingMissingFromTheFirstNumberOn) {
  SequenceGaps gaps;
  for (std::int64_t n = 4711; n < 10'000; ++n) gaps.see(n);
  EXPECT_EQ(gaps.missing(), 0U);
  EXPECT_EQ(gaps.newest(), 9999);
}

TEST(SequenceGaps, CountsWhatIsSkippedUntilItComes) {
  SequenceGaps gaps;
  for (const int n : {1, 2, 5, 7}) gaps.see(n);
  EXPECT_EQ(gaps.missing(), 3U);
  gaps.see(4);
  EXPECT_EQ(gaps.missing(), 2U);
  gaps.see(4);
  EXPECT_EQ(gaps.missing(), 2U);
  EXPECT_EQ(gaps.repeated(), 1U);
}

TEST(SequenceGaps, CountsASkipThatIsLongerThanTheWindowInFull) {
  SequenceGaps gaps;
  gaps.see(0);
  gaps.see(1'000'000);
  EXPECT_EQ(gaps.missing(), 999'999U);
  gaps.see(999'999);
  EXPECT_EQ(gaps.missing(), 999'998U);
}

TEST(SequenceGaps, StartsOverWhenTheNumbersDo) {
  SequenceGaps gaps;
  for (std::int64_t n = 0; n < 5000; ++n) gaps.see(n);
  for (std::int64_t n = 0; n < 10; ++n) gaps.see(n);
  EXPECT_EQ(gaps.missing(), 0U);
  EXPECT_EQ(gaps.restarts(), 1U);
  EXPECT_EQ(gaps.newest(), 9);
}

TEST(SequenceGaps, SurvivesEveryNumber) {
  SequenceGaps gaps;
  constexpr auto lowest = std::numeric_limits<std::int64_t>::min();
  constexpr auto highest = std::numeric_limits<std::int64_t>::max();
  for (const std::int64_t n :
       {lowest, highest, lowest, std::int64_t{-1}, std::int64_t{0}, highest}) {
    gaps.see(n);
  }
  EXPECT_EQ(gaps.newest(), highest);
}

TEST(SequenceGaps, AgreesWithASetUnderLossRepeatsAndDisorder) {
  std::mt19937 random(3);
  SequenceGaps gaps;
  std::set<std::int64_t> seen;
  gaps.see(0);
  seen.insert(0);
  std::uint64_t repeated = 0;
  for (std::int64_t n = 1; n < 20'000; ++n) {
    if (random() % 4 == 0) continue;
    const std::int64_t number = std::max<std::int64_t>(1, n - static_cast<int>(random() % 50));
    if (!seen.insert(number).second) ++repeated;
    gaps.see(number);
  }
  const auto expected = static_cast<std::uint64_t>(*seen.rbegin()) + 1 - seen.size();
  EXPECT_EQ(gaps.missing(), expected);
  EXPECT_EQ(gaps.repeated(), repeated);
}

}  // namespace
