#include "study/tracking.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace tachless::study {
namespace {

TEST(Envelope, KeepsEverySampleOfAShortCurve) {
  Envelope curve;
  for (int i = 0; i < 2000; ++i) curve.add(i, std::sin(i));
  const std::vector<Point> points = curve.points();
  ASSERT_EQ(points.size(), 2000U);
  for (int i = 0; i < 2000; ++i) {
    EXPECT_EQ(points[static_cast<std::size_t>(i)].x, i);
    EXPECT_EQ(points[static_cast<std::size_t>(i)].y, std::sin(i));
  }
}

TEST(Envelope, NeverHoldsMorePointsThanItSays) {
  Envelope curve;
  for (int i = 0; i < 123'457; ++i) {
    curve.add(i, std::sin(0.7 * i));
    if (i % 1000 == 0) {
      ASSERT_LE(curve.points().size(), Envelope::max_points);
    }
  }
  EXPECT_LE(curve.points().size(), Envelope::max_points);
  EXPECT_GE(curve.points().size(), Envelope::max_points / 4);
}

TEST(Envelope, KeepsASpikeOfOneSampleWhereItWas) {
  Envelope curve;
  for (int i = 0; i < 1'000'000; ++i) curve.add(i, i == 765'432 ? 9.0 : i == 12'345 ? -3.0 : 0.0);
  const std::vector<Point> points = curve.points();
  const auto high = std::max_element(points.begin(), points.end(),
                                     [](const Point& a, const Point& b) { return a.y < b.y; });
  const auto low = std::min_element(points.begin(), points.end(),
                                    [](const Point& a, const Point& b) { return a.y < b.y; });
  EXPECT_EQ(high->x, 765'432);
  EXPECT_EQ(high->y, 9.0);
  EXPECT_EQ(low->x, 12'345);
  EXPECT_EQ(low->y, -3.0);
}

TEST(Envelope, KeepsTheOrderOfTime) {
  Envelope curve;
  for (int i = 0; i < 50'000; ++i) curve.add(i, std::cos(0.31 * i) * i);
  const std::vector<Point> points = curve.points();
  EXPECT_TRUE(std::is_sorted(points.begin(), points.end(),
                             [](const Point& a, const Point& b) { return a.x < b.x; }));
}

}  // namespace
}  // namespace tachless::study
