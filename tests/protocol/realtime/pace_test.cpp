#include "protocol/realtime/pace.h"

#include <gtest/gtest.h>

#include <limits>

namespace tachless::protocol::realtime {
namespace {

using namespace std::chrono_literals;

constexpr auto t0 = loop::Clock::time_point(1000s);

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

}  // namespace
}  // namespace tachless::protocol::realtime
