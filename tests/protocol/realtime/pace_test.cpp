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

}  // namespace
}  // namespace tachless::protocol::realtime
