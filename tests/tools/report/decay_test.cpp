#include "report/decay.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace tachless::report {
namespace {

template <class F>
std::vector<study::Point> sampled(const F& value, double end_s = 2, int count = 2000) {
  std::vector<study::Point> points;
  for (int k = 0; k < count; ++k) {
    const double t_s = k * end_s / count;
    points.push_back({t_s, std::abs(value(t_s))});
  }
  return points;
}

TEST(Decay, FindsTheRateOfAnExponential) {
  const auto decay = fit_decay(sampled([](double t) { return 0.3 * std::exp(-4 * t); }));
  ASSERT_TRUE(decay);
  EXPECT_NEAR(decay->rate_per_s, 4, 1e-9);  // exact but for rounding
  EXPECT_NEAR(decay->amplitude, 0.3, 1e-9);
}

TEST(Decay, SeesThroughASwingToTheEnvelope) {
  const auto decay = fit_decay(sampled(
      [](double t) { return 0.3 * std::exp(-4 * t) * std::cos(2 * std::numbers::pi * 10 * t); }));
  ASSERT_TRUE(decay);
  // The envelope is a staircase with a step every 0.05 s, over about 2 s.
  EXPECT_NEAR(decay->rate_per_s, 4, 0.1);
}

TEST(Decay, EndsWhereAPlateauBegins) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> noise(-1e-4, 1e-4);
  const auto decay = fit_decay(sampled([&](double t) {
    return 0.3 * std::exp(-30 * t) + 1e-4 * std::sin(300 * t) + noise(random);
  }));
  ASSERT_TRUE(decay);
  EXPECT_NEAR(decay->rate_per_s, 30, 1.5);
  // 0.3 exp(-30 t) reaches 2e-4 at 0.24 s.
  EXPECT_NEAR(decay->to_s, 0.24, 0.05);
}

TEST(Decay, StartsAtThePeakOfASignalThatRisesFirst) {
  const auto decay = fit_decay(sampled([](double t) { return t * std::exp(-10 * t) + 1e-9; }));
  ASSERT_TRUE(decay);
  EXPECT_GE(decay->from_s, 0.099);
}

TEST(Decay, IsNotMovedByAnOddSpike) {
  const auto decay = fit_decay(
      sampled([](double t) { return t > 0.5 && t < 0.502 ? 0.2 : 0.3 * std::exp(-4 * t); }));
  ASSERT_TRUE(decay);
  EXPECT_GT(decay->rate_per_s, 3);
  EXPECT_LT(decay->rate_per_s, 5);
}

TEST(Decay, SaysWhenThereIsNone) {
  EXPECT_FALSE(fit_decay({}));
  EXPECT_FALSE(fit_decay(sampled([](double) { return 0.0; })));
  EXPECT_FALSE(fit_decay(sampled([](double) { return 1.0; })));
  EXPECT_FALSE(fit_decay(sampled([](double t) { return std::sin(20 * t); })));
  EXPECT_FALSE(fit_decay(sampled([](double t) { return std::exp(3 * t); })));
  EXPECT_FALSE(fit_decay(sampled([](double t) { return t < 1 ? 1.0 : INFINITY; })));
}

}  // namespace
}  // namespace tachless::report
