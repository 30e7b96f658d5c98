#include "numerics/sign_change.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tachless::numerics {
namespace {

TEST(SignChange, IsFoundFromBothSidesWithFewEvaluations) {
  int evaluations = 0;
  const auto f = [&](double x) {
    ++evaluations;
    return std::exp(x) - 2;
  };
  const double accuracy = 1e-10;
  const double rising = last_negative(f, {0, -1}, {3, std::exp(3) - 2}, accuracy);
  EXPECT_LT(rising, std::log(2));
  EXPECT_GT(rising, std::log(2) - accuracy);
  EXPECT_LE(evaluations, 20);  // halving takes 35
  const auto falling = [&](double x) { return -f(x); };
  const double from_right = last_negative(falling, {3, 2 - std::exp(3)}, {0, 1}, accuracy);
  EXPECT_GT(from_right, std::log(2));
  EXPECT_LT(from_right, std::log(2) + accuracy);
}

/// A jump takes no more than four times the evaluations of halving.
TEST(SignChange, IsFoundAtAJump) {
  int evaluations = 0;
  const auto jump = [&](double x) {
    ++evaluations;
    return x < 0.3 ? -1.0 : 1e6;
  };
  EXPECT_NEAR(last_negative(jump, {0, -1}, {1, 1e6}, 1e-6), 0.3, 1e-6);
  EXPECT_LE(evaluations, 4 * 20);
}

}  // namespace
}  // namespace tachless::numerics
