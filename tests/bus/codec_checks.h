#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "bus/wire.h"

/// Checks that every codec must pass, whatever it carries. A test describes its type by a struct:
///   using Value, Message (as lcm-gen generates it);
///   static Message message(const loop::Layout&, Random&);  // filled at random, all legal
/// Equality of values is equality of the bytes that a second codec makes of them.
namespace tachless::codec_checks {

using Bytes = std::vector<std::byte>;
constexpr loop::Stamp stamp{50, 0x0123456789abcdef, 7};

class Random {
 public:
  double real() { return std::normal_distribution<>(0, 10)(engine_); }
  std::vector<double> reals(int n) {
    std::vector<double> values(n);
    for (double& value : values) value = real();
    return values;
  }
  bool coin() { return std::bernoulli_distribution()(engine_); }

 private:
  std::mt19937_64 engine_{20240229};
};

inline std::vector<loop::Layout> layouts() {
  std::vector<loop::Layout> all;
  for (const int n : {1, 2, 7, 64}) {
    all.push_back({n, 0, 1});
    all.push_back({n, n, 2});
  }
  return all;
}

template <class Message>
Bytes lcm_bytes(const Message& message) {
  Bytes bytes(message.getEncodedSize());
  EXPECT_EQ(message.encode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return bytes;
}

template <class Type>
Bytes sample(const loop::Layout& layout) {
  Random random;
  auto message = Type::message(layout, random);
  message.utime = stamp.utime;
  message.run = stamp.run;
  message.tick = stamp.tick;
  return lcm_bytes(message);
}

/// What the codec makes of a generated message.
template <class Value, class Message>
Value decoded(const loop::Layout& layout, const Message& message) {
  loop::Stamp got;
  Value value;
  EXPECT_EQ(bus::Codec<Value>(layout).decode(lcm_bytes(message), got, value), bus::Rejection::none);
  return value;
}

inline std::vector<double> reals_of(const robot::Vector& vector) {
  return {vector.begin(), vector.end()};
}

template <class Type>
bus::Rejection verdict(const loop::Layout& layout, std::span<const std::byte> bytes) {
  const bus::Codec<typename Type::Value> codec(layout);
  loop::Stamp got;
  typename Type::Value value;
  return codec.decode(bytes, got, value);
}

inline void overwrite(Bytes& bytes, std::size_t offset, std::uint64_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) {
    bytes.at(offset + size - 1 - i) = static_cast<std::byte>(value >> 8 * i);
  }
}
inline void overwrite_int32(Bytes& bytes, std::size_t offset, std::int32_t value) {
  overwrite(bytes, offset, static_cast<std::uint32_t>(value), 4);
}
inline void overwrite_real(Bytes& bytes, std::size_t offset, double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  overwrite(bytes, offset, bits, 8);
}

/// What liblcm encodes we decode, and encode again to the very same bytes.
template <class Type>
void agrees_with_generated_code() {
  for (const loop::Layout& layout : layouts()) {
    const Bytes bytes = sample<Type>(layout);
    const bus::Codec<typename Type::Value> reader(layout);
    bus::Codec<typename Type::Value> writer(layout);
    loop::Stamp got;
    typename Type::Value value;
    ASSERT_EQ(reader.decode(bytes, got, value), bus::Rejection::none);
    EXPECT_EQ(got.utime, stamp.utime);
    EXPECT_EQ(got.run, stamp.run);
    EXPECT_EQ(got.tick, stamp.tick);
    const auto again = writer.encode(got, value);
    EXPECT_EQ(Bytes(again.begin(), again.end()), bytes) << layout.num_joints << " joints";
  }
}

/// No cut, no flipped bit and no appended byte crashes, and what is accepted is finite. A
/// rejected message leaves stamp and value as they were.
template <class Type>
void survives_damage() {
  using bus::all_finite;
  for (const loop::Layout& layout : layouts()) {
    const bus::Codec<typename Type::Value> codec(layout);
    bus::Codec<typename Type::Value> writer(layout);
    const Bytes whole = sample<Type>(layout);
    loop::Stamp got;
    typename Type::Value value;
    ASSERT_EQ(codec.decode(whole, got, value), bus::Rejection::none);
    const auto untouched = [&] {
      const auto again = writer.encode(got, value);
      return std::equal(again.begin(), again.end(), whole.begin(), whole.end());
    };

    for (std::size_t size = 0; size < whole.size(); ++size) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      ASSERT_NE(codec.decode(cut, got, value), bus::Rejection::none) << "cut to " << size;
    }
    ASSERT_TRUE(untouched());
    Bytes longer = whole;
    longer.push_back(std::byte{0});
    ASSERT_EQ(codec.decode(longer, got, value), bus::Rejection::wrong_size);
    ASSERT_TRUE(untouched());

    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
      Bytes flipped = whole;
      flipped[bit / 8] ^= static_cast<std::byte>(1U << bit % 8);
      loop::Stamp flipped_stamp = got;
      typename Type::Value flipped_value = value;
      if (codec.decode(flipped, flipped_stamp, flipped_value) == bus::Rejection::none) {
        ASSERT_TRUE(all_finite(flipped_value)) << "bit " << bit;
      }
    }
  }
}

/// Every real of the message, set to each of the non-finite values, is found.
template <class Type>
void rejects_non_finite(std::size_t first_real, std::size_t num_reals, const loop::Layout& layout) {
  for (std::size_t i = 0; i < num_reals; ++i) {
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::signaling_NaN(),
          std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
      Bytes bytes = sample<Type>(layout);
      overwrite_real(bytes, first_real + 8 * i, bad);
      EXPECT_EQ(verdict<Type>(layout, bytes), bus::Rejection::non_finite) << "real " << i;
    }
  }
}

/// A count that contradicts the layout is found, whatever it would make of the length.
template <class Type>
void rejects_counts(std::size_t offset, const loop::Layout& layout) {
  for (const std::int32_t count : {0x20000000, 0x7fffffff, -1, -0x7fffffff - 1, 3, 65}) {
    Bytes bytes = sample<Type>(layout);
    overwrite_int32(bytes, offset, count);
    EXPECT_EQ(verdict<Type>(layout, bytes), bus::Rejection::wrong_count) << count;
  }
}

template <class Type>
void rejects_other_fingerprint() {
  const loop::Layout layout{2, 2, 2};
  Bytes bytes = sample<Type>(layout);
  bytes[0] ^= std::byte{1};
  EXPECT_EQ(verdict<Type>(layout, bytes), bus::Rejection::wrong_type);
}

}  // namespace tachless::codec_checks
