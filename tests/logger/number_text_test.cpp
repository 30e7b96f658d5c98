#include "logger/number_text.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <random>
#include <string>

namespace tachless::logger {
namespace {

std::string ours(double value) {
  std::array<char, longest_number> text;
  return {text.data(), write_number(text.data(), value)};
}

std::string printf_s(double value) {
  std::array<char, 64> text;
  std::snprintf(text.data(), text.size(), "%.17g", value);
  return text.data();
}

TEST(NumberText, IsPrintfsForAnyBits) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 100'000; ++i) {
    const auto value = std::bit_cast<double>(random());
    ASSERT_EQ(ours(value), printf_s(value));
  }
}

TEST(NumberText, IsPrintfsForWhatRunsAreMadeOf) {
  std::mt19937_64 random(2);
  for (int i = 0; i < 200'000; ++i) {
    // All sizes that the table serves, and beyond; times; counts of an encoder, among which are
    // ties in the 17th digit.
    const double mantissa = 1 + std::ldexp(static_cast<double>(random() >> 12), -52);
    const double sign = i % 2 == 0 ? 1 : -1;
    const int exponent = static_cast<int>(random() % 210) - 105;
    const int bits = static_cast<int>(random() % 60);
    for (const double value : {sign * std::ldexp(mantissa, exponent), i * 5e-5,
                               std::ldexp(static_cast<double>(random() >> bits), -bits)}) {
      ASSERT_EQ(ours(value), printf_s(value));
    }
  }
}

TEST(NumberText, IsPrintfsAroundPowersOfTenAndTwo) {
  for (int exponent = -110; exponent <= 110; ++exponent) {
    for (const double power : {std::pow(10.0, exponent), std::ldexp(1.0, exponent)}) {
      for (const double towards : {0.0, power, 2 * power}) {
        const double value = std::nextafter(power, towards);
        EXPECT_EQ(ours(value), printf_s(value));
      }
    }
  }
  using Limits = std::numeric_limits<double>;
  for (const double value : {0.0, -0.0, Limits::infinity(), -Limits::infinity(),
                             Limits::quiet_NaN(), Limits::max(), Limits::denorm_min()}) {
    EXPECT_EQ(ours(value), printf_s(value));
  }
}

}  // namespace
}  // namespace tachless::logger
