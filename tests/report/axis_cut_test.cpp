#include "report/axis_cut.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tachless::report {
namespace {

std::vector<study::Point> swing(double kick) {
  std::vector<study::Point> points;
  for (int k = 0; k < 1000; ++k) points.push_back({k * 1.0, std::sin(k * 0.1)});
  points[3].y = kick;
  return points;
}

TEST(AxisCut, LeavesAnAxisWhoseCurveFillsIt) {
  EXPECT_FALSE(cut_at_kick(range_of(swing(2)), usual_range(swing(2))));
  EXPECT_FALSE(cut_at_kick({}, {}));
}

TEST(AxisCut, CutsAtAKickAndKeepsTheRestWithAMargin) {
  const Range whole = range_of(swing(-500));
  const auto cut = cut_at_kick(whole, usual_range(swing(-500)));
  ASSERT_TRUE(cut);
  EXPECT_LT(cut->low, -1);
  EXPECT_GT(cut->low, -2);
  EXPECT_GT(cut->high, 1);
  EXPECT_EQ(cut_note(whole, "N m"), "axis cut: peak 500 N m");
}

}  // namespace
}  // namespace tachless::report
