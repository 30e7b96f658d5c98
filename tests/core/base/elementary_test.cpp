#include "base/elementary.h"

#include <gtest/gtest.h>
#include <mpfr.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

namespace tachless::base {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double least = std::numeric_limits<double>::denorm_min();
constexpr double largest = std::numeric_limits<double>::max();

/// A number of MPFR with 200 bits: its functions are exact beside a double's 53.
class Exact {
 public:
  explicit Exact(double x = 0) {
    mpfr_init2(value_, 200);
    mpfr_set_d(value_, x, MPFR_RNDN);
  }
  Exact(const Exact&) = delete;
  Exact& operator=(const Exact&) = delete;
  ~Exact() { mpfr_clear(value_); }
  mpfr_ptr get() { return value_; }

  /// Returns how far `x` is off, in units of the last place of the rounded exact value.
  double ulps(double x) {
    const double rounded = mpfr_get_d(value_, MPFR_RNDN);
    if (std::isinf(rounded) || std::isinf(x)) return rounded == x ? 0 : inf;
    mpfr_sub_d(value_, value_, x, MPFR_RNDN);
    const double magnitude = std::abs(rounded);
    const double ulp =
        std::max(least, magnitude - std::nextafter(magnitude, 0));  // the smaller one at 2^k
    return std::abs(mpfr_get_d(value_, MPFR_RNDN)) / ulp;
  }

 private:
  mpfr_t value_;
};

using OfMpfr = int (*)(mpfr_ptr, mpfr_srcptr, mpfr_rnd_t);

/// Expects errors of `ours` below 1 ulp at all points.
void expect_within_an_ulp(double (*ours)(double), OfMpfr exact, const std::vector<double>& points) {
  Exact x, y;
  double most = 0, where = 0;
  for (const double point : points) {
    mpfr_set_d(x.get(), point, MPFR_RNDN);
    exact(y.get(), x.get(), MPFR_RNDN);
    const double error = y.ulps(ours(point));
    if (!(error <= most)) most = error, where = point;
  }
  EXPECT_LT(most, 1) << "at " << where;
}

/// Returns 100,000 numbers: evenly from `low` to `high`, and evenly in their logarithm from the
/// smallest subnormal to `high`, with both signs if `low` is negative.
std::vector<double> points(double low, double high) {
  std::mt19937_64 random(51);
  std::vector<double> x = {high, low, least};
  std::uniform_real_distribution<double> even(low, high);
  std::uniform_int_distribution<std::uint64_t> bits(1, std::bit_cast<std::uint64_t>(high));
  for (int i = 0; i < 50000; ++i) {
    x.push_back(even(random));
    const double magnitude = std::bit_cast<double>(bits(random));
    x.push_back(low < 0 && i % 2 == 0 ? -magnitude : magnitude);
  }
  return x;
}

/// Returns numbers near multiples of pi/2, at which a reduction loses most.
std::vector<double> near_quarter_turns() {
  // No double is nearer to a multiple of pi/2 (Kahan; J.-M. Muller, Elementary Functions, 2016).
  std::vector<double> x = {0x1.6ac5b262ca1ffp849, 0x1.921fb54442d18p0, 0x1.921fb54442d18p1};
  std::mt19937_64 random(52);
  std::uniform_real_distribution<double> exponent(0, 60);
  for (int i = 0; i < 20000; ++i) {
    const double n = i < 5000 ? i : std::floor(std::exp2(exponent(random)));
    Exact turns;
    mpfr_const_pi(turns.get(), MPFR_RNDN);
    mpfr_mul_d(turns.get(), turns.get(), n / 2, MPFR_RNDN);
    x.push_back(mpfr_get_d(turns.get(), MPFR_RNDN));
    x.push_back(std::nextafter(x.back(), inf));
  }
  for (int i = 18; i < 22; ++i) {  // where one reduction ends and the other begins
    for (const double bound : {std::ldexp(1, i), -std::ldexp(1, i)}) {
      for (const double to : {-inf, inf}) x.push_back(std::nextafter(bound, to));
      x.push_back(bound);
    }
  }
  return x;
}

TEST(Elementary, SineAndCosineAreWithinAnUlp) {
  for (const auto& x : {points(-10, 10), points(-1e7, 1e7), points(-largest / 4, largest / 4),
                        near_quarter_turns()}) {
    expect_within_an_ulp(sin, mpfr_sin, x);
    expect_within_an_ulp(cos, mpfr_cos, x);
  }
}

TEST(Elementary, SineAndCosineTogetherHaveTheBitsOfEach) {
  for (const double x : points(-100, 100)) {
    double s = 0, c = 0;
    sin_cos(x, s, c);
    ASSERT_EQ(s, sin(x));
    ASSERT_EQ(c, cos(x));
  }
}

TEST(Elementary, ExponentialIsWithinAnUlp) {
  expect_within_an_ulp(exp, mpfr_exp, points(-745.2, 709.79));
  expect_within_an_ulp(exp, mpfr_exp, points(-2, 2));
}

TEST(Elementary, ExponentialLessOneIsWithinAnUlp) {
  expect_within_an_ulp(expm1, mpfr_expm1, points(-60, 709.79));
  expect_within_an_ulp(expm1, mpfr_expm1, points(-1, 1));
}

TEST(Elementary, LogarithmIsWithinAnUlp) {
  expect_within_an_ulp(log, mpfr_log, points(least, largest));
  expect_within_an_ulp(log, mpfr_log, points(0.5, 2));
  std::vector<double> beside_1;
  for (int i = -60; i < -5; ++i) {
    for (const double share : {1.0, 1.1, 1.37, 1.99}) {
      beside_1.push_back(1 + share * std::ldexp(1, i));
      beside_1.push_back(1 - share * std::ldexp(1, i));
    }
  }
  expect_within_an_ulp(log, mpfr_log, beside_1);
}

TEST(Elementary, HyperbolicTangentIsWithinAnUlp) {
  expect_within_an_ulp(tanh, mpfr_tanh, points(-22, 22));
  expect_within_an_ulp(tanh, mpfr_tanh, points(-0.5, 0.5));
}

TEST(Elementary, CubeRootIsWithinAnUlp) {
  expect_within_an_ulp(cbrt, mpfr_cbrt, points(-largest / 4, largest / 4));
}

TEST(Elementary, PowerIsWithinAnUlp) {
  std::mt19937_64 random(53);
  std::uniform_int_distribution<std::uint64_t> bits(1, std::bit_cast<std::uint64_t>(largest));
  std::uniform_real_distribution<double> share(-1.01, 1.01), beside_1(0.9, 1.1);
  Exact x, y;
  for (int i = 0; i < 100000; ++i) {
    const double base = i % 2 == 0 ? std::bit_cast<double>(bits(random)) : beside_1(random);
    // Over the whole range of results, overflow and underflow included.
    const double power = i % 5 == 0 ? 0.2 : share(random) * 745 / std::abs(std::log(base));
    mpfr_set_d(x.get(), base, MPFR_RNDN);
    mpfr_set_d(y.get(), power, MPFR_RNDN);
    mpfr_pow(y.get(), x.get(), y.get(), MPFR_RNDN);
    ASSERT_LT(y.ulps(pow(base, power)), 1) << base << " to " << power;
  }
}

TEST(Elementary, SpecialValuesAreThoseOfTheStandard) {
  for (auto* odd : {sin, expm1, tanh, cbrt}) {
    EXPECT_TRUE(std::signbit(odd(-0.0)) && odd(-0.0) == 0);
    EXPECT_TRUE(!std::signbit(odd(0.0)) && odd(0.0) == 0);
  }
  for (auto* straight : {sin, expm1, tanh}) {
    EXPECT_EQ(straight(least), least);
    EXPECT_EQ(straight(-least), -least);
  }
  for (auto* any : {sin, cos, exp, expm1, log, tanh, cbrt}) EXPECT_TRUE(std::isnan(any(nan)));
  for (auto* bounded : {sin, cos}) {
    EXPECT_TRUE(std::isnan(bounded(inf)) && std::isnan(bounded(-inf)));
  }
  EXPECT_EQ(cos(0), 1);
  EXPECT_EQ(cos(least), 1);
  EXPECT_EQ(exp(0), 1);
  EXPECT_EQ(exp(-0.0), 1);
  EXPECT_EQ(exp(inf), inf);
  EXPECT_EQ(exp(-inf), 0);
  EXPECT_EQ(exp(709.8), inf);
  EXPECT_EQ(exp(-746), 0);
  EXPECT_EQ(expm1(inf), inf);
  EXPECT_EQ(expm1(-inf), -1);
  EXPECT_EQ(log(1), 0);
  EXPECT_FALSE(std::signbit(log(1)));
  EXPECT_EQ(log(0.0), -inf);
  EXPECT_EQ(log(-0.0), -inf);
  EXPECT_EQ(log(inf), inf);
  EXPECT_TRUE(std::isnan(log(-1)) && std::isnan(log(-inf)));
  EXPECT_EQ(tanh(inf), 1);
  EXPECT_EQ(tanh(-inf), -1);
  EXPECT_EQ(cbrt(inf), inf);
  EXPECT_EQ(cbrt(-27), -3);
}

TEST(Elementary, SpecialPowersAreThoseOfTheStandard) {
  for (const double x : {0.0, 1.0, 2.5, inf, nan}) EXPECT_EQ(pow(x, 0), 1);
  for (const double y : {-inf, -1.0, 3.0, inf, nan}) EXPECT_EQ(pow(1, y), 1);
  EXPECT_TRUE(std::isnan(pow(nan, 1)) && std::isnan(pow(2, nan)) && std::isnan(pow(-2, 2)));
  for (const double y : {0.5, 3.0, inf}) {
    EXPECT_EQ(pow(0, y), 0);
    EXPECT_EQ(pow(0, -y), inf);
    EXPECT_EQ(pow(inf, y), inf);
    EXPECT_EQ(pow(inf, -y), 0);
  }
  EXPECT_EQ(pow(2, inf), inf);
  EXPECT_EQ(pow(2, -inf), 0);
  EXPECT_EQ(pow(0.5, inf), 0);
  EXPECT_EQ(pow(0.5, -inf), inf);
  EXPECT_EQ(pow(std::nextafter(1, 2), 1e300), inf);
  EXPECT_EQ(pow(2, 1023), 0x1p1023);
  EXPECT_EQ(pow(2, -1074), least);
  EXPECT_EQ(pow(2, 1e-300), 1);
}

}  // namespace
}  // namespace tachless::base
