#include "node/latency_histogram.h"

#include <gtest/gtest.h>

namespace tachless::node {
namespace {

using namespace std::chrono_literals;

TEST(ALatencyHistogram, IsEmptyAtFirst) {
  const LatencyHistogram histogram;
  EXPECT_EQ(histogram.count(), 0);
  EXPECT_EQ(histogram.percentile_us(0.5), 0);
  EXPECT_EQ(histogram.max_us(), 0);
  EXPECT_TRUE(histogram.buckets().empty());
}

TEST(ALatencyHistogram, GivesPercentilesToTheWidthOfABucket) {
  LatencyHistogram histogram;
  for (int us = 1; us <= 10'000; ++us) histogram.add(std::chrono::microseconds(us));
  // A bucket is a sixteenth of an octave wide: 1/16 at most, never below the true value.
  EXPECT_GE(histogram.percentile_us(0.5), 5000);
  EXPECT_LE(histogram.percentile_us(0.5), 5000 * (1 + 1.0 / 16));
  EXPECT_GE(histogram.percentile_us(0.99), 9900);
  EXPECT_LE(histogram.percentile_us(0.99), 10'000);
  EXPECT_EQ(histogram.percentile_us(1), 10'000);
  EXPECT_EQ(histogram.max_us(), 10'000);
}

TEST(ALatencyHistogram, HoldsEveryDurationInItsBucket) {
  for (std::int64_t ns = 1; ns < 60'000'000'000; ns += ns / 7 + 1) {
    LatencyHistogram histogram;
    histogram.add(std::chrono::nanoseconds(ns));
    const auto buckets = histogram.buckets();
    ASSERT_EQ(buckets.size(), 1U);
    const double us = static_cast<double>(ns) * 1e-3;
    EXPECT_LE(buckets[0].from_us, us * (1 + 1e-12));  // rounding of the conversion to us
    EXPECT_GE(buckets[0].from_us * (1 + 1.0 / 16) + 1e-3, us);
    EXPECT_DOUBLE_EQ(histogram.percentile_us(0.5), us);
  }
}

TEST(ALatencyHistogram, TakesTheAbsurd) {
  LatencyHistogram histogram;
  histogram.add(-5ns);
  histogram.add(std::chrono::hours(24 * 365));
  EXPECT_EQ(histogram.count(), 2);
  EXPECT_EQ(histogram.buckets().size(), 2U);
}

}  // namespace
}  // namespace tachless::node
