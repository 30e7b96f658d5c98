#include "session/statistics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <stdexcept>

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using messages::Role;

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
  // A bucket is a sixteenth of an octave wide: the value is at most 1/16 above the true one, and
  // never below it.
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

TEST(Statistics, AreReadBackAsTheyWereWritten) {
  Statistics plant(Role::plant);
  plant.exit_code = base::ExitCode::peer_lost;
  plant.fault = "the logger has been silent";
  plant.run_id = 7;
  plant.wall_s = 1.25;
  plant.resends = 3;
  plant.rejected.add(messages::Rejection::wrong_size);
  plant.rejected.add(Discard::too_old, 4);
  plant.plant().saturated_ticks = {0, 9};
  plant.plant().beyond_limit_ticks = {3, 0};
  plant.plant().robot_is_clock = true;
  for (const int us : {15, 80, 81, 950}) {
    plant.plant().round_trip_us.add(std::chrono::microseconds(us));
  }

  const std::string text = to_json(plant);
  const Statistics read = statistics_from_json(text);
  EXPECT_EQ(to_json(read), text) << "percentiles and histogram, too";
  EXPECT_EQ(read.role, Role::plant);
  EXPECT_EQ(read.exit_code, base::ExitCode::peer_lost);
  EXPECT_EQ(read.fault, "the logger has been silent");
  EXPECT_EQ(read.rejected.total(), 5);
  EXPECT_EQ(read.plant().saturated_ticks, (std::vector<std::int64_t>{0, 9}));
  EXPECT_EQ(read.plant().beyond_limit_ticks, (std::vector<std::int64_t>{3, 0}));
  EXPECT_TRUE(read.plant().robot_is_clock);
  EXPECT_EQ(read.plant().round_trip_us.count(), 4);
  EXPECT_EQ(read.plant().round_trip_us.max_us(), 950);
}

TEST(Statistics, OfEachRoleHoldItsCountersAndNoOther) {
  Statistics logger(Role::logger);
  logger.logger().log = {"out/lcmlog", 61, 10, 2};
  EXPECT_EQ(statistics_from_json(to_json(logger)).logger().log.gaps, 2);
  EXPECT_THAT(to_json(logger), testing::Not(testing::HasSubstr("missed_commands")));
  Statistics controller(Role::controller);
  controller.controller().skipped_ticks = 8;
  EXPECT_EQ(statistics_from_json(to_json(controller)).controller().skipped_ticks, 8);
  EXPECT_EQ(statistics_from_json(to_json(Statistics(Role::reference))).role, Role::reference);
}

TEST(Statistics, OfAnotherShapeAreRefused) {
  EXPECT_THROW(statistics_from_json("{}"), std::invalid_argument);
  EXPECT_THROW(statistics_from_json("{\"role\": "), std::invalid_argument);
  std::string text = to_json(Statistics(Role::plant));
  text.replace(text.find("plant"), 5, "pilot");
  EXPECT_THROW(statistics_from_json(text), std::invalid_argument);
}

}  // namespace
}  // namespace tachless::session
