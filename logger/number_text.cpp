#include "logger/number_text.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

namespace tachless::logger {
namespace {

__extension__ using Product = unsigned __int128;

constexpr int num_digits = 17;
constexpr std::uint64_t ten_to_16 = 10'000'000'000'000'000;
// The table serves |value| above 2^-100 (7.9e-31) and below 2^100.
constexpr double least_served = 0x1p-100;
constexpr double most_served = 0x1p100;
constexpr int largest_power = 48;

/// mantissa 2^exponent, the mantissa with its first bit set and rounded.
struct Power {
  std::uint64_t mantissa = 0;
  int exponent = 0;
};

/// 10^(i - largest_power).
const std::array<Power, 2 * largest_power + 1> powers_of_ten = [] {
  static_assert(std::numeric_limits<long double>::digits >= 64);
  std::array<Power, 2 * largest_power + 1> powers{};
  int exponent = -largest_power;
  for (Power& power : powers) {
    const long double value = std::strtold(("1e" + std::to_string(exponent++)).c_str(), nullptr);
    const long double fraction = std::frexp(value, &power.exponent);
    power.mantissa = static_cast<std::uint64_t>(std::rint(std::ldexp(fraction, 64)));
    power.exponent -= 64;
  }
  return powers;
}();

struct Decimal {
  std::uint64_t digits = 0;  ///< 17 of them; 0: it takes more precision to know them
  int exponent = 0;          ///< of the first digit
};

/// Of `value` > 0, within what the table serves.
Decimal decimal_of(double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  const int binary = static_cast<int>(bits >> 52) - 1023;
  const std::uint64_t mantissa = (bits << 11) | (std::uint64_t{1} << 63);
  Decimal result{0, (binary * 78'913) >> 18};  // floor(binary log10(2)): right, or one too little
  for (;; ++result.exponent) {
    const int index = largest_power + num_digits - 1 - result.exponent;
    const Power power = powers_of_ten[static_cast<std::size_t>(index)];
    // value 10^(16 - exponent) = product 2^-shift; 66 < shift < 75, for it is 1e16 to 1e18.
    const Product product = static_cast<Product>(mantissa) * power.mantissa;
    const int shift = 63 - binary - power.exponent;
    const auto whole = static_cast<std::uint64_t>(product >> shift);
    if (whole >= 10 * ten_to_16) continue;
    const auto rest = static_cast<std::uint32_t>(product >> (shift - 32));
    // The power is rounded to 2^-64: the product may be 1e17 2^-64 = 0.0055 wrong, at most 2^25 of
    // 2^32 here.
    constexpr std::uint32_t half = std::uint32_t{1} << 31;
    constexpr std::uint32_t doubt = std::uint32_t{1} << 25;
    if (rest - (half - doubt) < 2 * doubt) return result;
    const std::uint64_t rounded = whole + (rest >> 31);
    if (rounded >= ten_to_16 && rounded < 10 * ten_to_16) result.digits = rounded;
    return result;
  }
}

/// Eight digits of `value` < 1e8.
void write_eight(char* to, std::uint64_t value) {
  static const std::array<char, 200> pairs = [] {
    std::array<char, 200> text{};
    for (std::size_t i = 0; i < 100; ++i) {
      text[2 * i] = static_cast<char>('0' + i / 10);
      text[2 * i + 1] = static_cast<char>('0' + i % 10);
    }
    return text;
  }();
  auto left = static_cast<std::uint32_t>(value);
  for (int i = 3; i >= 0; --i, left /= 100) std::memcpy(to + 2 * i, &pairs[2 * (left % 100)], 2);
}

}  // namespace

char* write_number(char* to, double value) {
  char* const end = to + longest_number;
  const double size = std::abs(value);
  if (value == 0 && !std::signbit(value)) {
    *to = '0';
    return to + 1;
  }
  Decimal decimal;
  if (size > least_served && size < most_served) decimal = decimal_of(size);
  if (decimal.digits == 0 || decimal.exponent < -4 || decimal.exponent >= num_digits) {
    return std::to_chars(to, end, value, std::chars_format::general, num_digits).ptr;
  }
  if (value < 0) *to++ = '-';
  // The digits where they end up if they are all behind the point.
  const int before_point = decimal.exponent + 1;
  char* const first = before_point > 0 ? to + 1 : std::fill_n(to, 2 - before_point, '0');
  constexpr std::uint64_t ten_to_8 = 100'000'000;
  *first = static_cast<char>('0' + decimal.digits / ten_to_16);
  write_eight(first + 1, decimal.digits / ten_to_8 % ten_to_8);
  write_eight(first + 9, decimal.digits % ten_to_8);
  char* last = first + num_digits;
  while (last[-1] == '0') --last;
  char* const point = before_point > 0 ? std::copy_n(first, before_point, to) : to + 1;
  if (last <= point + 1) return point;
  *point = '.';
  return last;
}

}  // namespace tachless::logger
