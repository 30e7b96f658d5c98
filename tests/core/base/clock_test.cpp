#include "base/clock.h"

#include <gtest/gtest.h>

namespace tachless::base {
namespace {

using std::chrono::nanoseconds;

// Exact: the products with 1e9 round to these whole numbers.
TEST(Time, SecondsBecomeNanosecondsAndBack) {
  EXPECT_EQ(nanoseconds_of(0.25), nanoseconds(250'000'000));
  EXPECT_EQ(nanoseconds_of(1e-9), nanoseconds(1));
  EXPECT_EQ(nanoseconds_of(-2), nanoseconds(-2'000'000'000));
  EXPECT_EQ(seconds_of(nanoseconds(500'000'000)), 0.5);
}

TEST(Time, PartsOfANanosecondAreCutOff) { EXPECT_EQ(nanoseconds_of(1.9e-9), nanoseconds(1)); }

}  // namespace
}  // namespace tachless::base
