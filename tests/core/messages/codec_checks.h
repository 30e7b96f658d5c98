#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "messages/wire.h"

/// Checks of every codec against the code that lcm-gen generates. Two values count as equal if a
/// second codec encodes them to the same bytes.
namespace tachless::codec_checks {

using Bytes = std::vector<std::byte>;
constexpr std::size_t body = 32;  ///< begin of a body: after fingerprint, utime, run and tick
constexpr messages::Stamp stamp{50, 0x0123456789abcdef, 7};

/// A value and the message that lcm-gen generates for it.
template <class ValueType, class MessageType>
struct Pair {
  using Value = ValueType;
  using Message = MessageType;
};

/// Returns a value with every field filled with random legal values.
template <class Value>
Value random_value(const messages::Layout& layout) {
  std::mt19937_64 engine{20240229};
  std::normal_distribution<> normal(0, 10);
  Value value;
  if constexpr (requires { value.num; }) value.num = layout.num_signals;
  messages::for_each_field<Value>([&](const auto& field) {
    auto& member = value.*field.member;
    using Member = std::remove_reference_t<decltype(member)>;
    const int length =
        field.count == messages::Count::motors ? layout.num_motors : layout.num_joints;
    const auto fill = [&](Vector& vector) {
      vector.resize(length);
      for (double& each : vector) each = normal(engine);
    };
    if constexpr (std::is_same_v<Member, Vector>) {
      fill(member);
    } else if constexpr (requires { member[0].allFinite(); }) {
      for (int row = 0; row < layout.num_signals; ++row) fill(member[row]);
    } else if constexpr (std::is_same_v<Member, messages::PerRole>) {
      for (std::int64_t& each : member) each = static_cast<std::int64_t>(engine());
    } else if constexpr (std::is_same_v<Member, std::string>) {
      member = field.name == "signals" ? "error:rad,nu:rad/s" : std::string(field.name);
    } else if constexpr (std::is_same_v<Member, messages::Role>) {
      member = messages::Role::controller;
    } else if constexpr (requires { member.size(); }) {
      for (int i = 0; i < length; ++i) member[i] = engine() % 2 == 1;
    } else if (field.kind == messages::Kind::int64) {
      member = static_cast<Member>(field.lowest > 0 ? engine() >> 1 : engine());
    } else if (field.kind == messages::Kind::real) {
      member = static_cast<Member>(std::abs(normal(engine)));
    } else {
      member = static_cast<Member>(std::min(field.highest, 130.0));
    }
  });
  return value;
}

inline std::vector<messages::Layout> layouts() {
  std::vector<messages::Layout> all;
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
Bytes sample(const messages::Layout& layout) {
  using Value = typename Type::Value;
  messages::Codec<Value> codec(layout);
  const auto bytes = codec.encode(stamp, random_value<Value>(layout));
  return {bytes.begin(), bytes.end()};
}

/// Returns a sample as decoded by the generated code.
template <class Type>
typename Type::Message message_of(const messages::Layout& layout) {
  const Bytes bytes = sample<Type>(layout);
  typename Type::Message message;
  const auto size = static_cast<int>(bytes.size());
  EXPECT_EQ(message.decode(bytes.data(), 0, size), size);
  return message;
}

inline std::vector<double> reals_of(const Vector& vector) { return {vector.begin(), vector.end()}; }

template <class Type>
messages::Rejection verdict(const messages::Layout& layout, std::span<const std::byte> bytes) {
  const messages::Codec<typename Type::Value> codec(layout);
  messages::Stamp got;
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

/// Checks that liblcm decodes our bytes and encodes them to the same bytes, and that our codec does
/// too.
template <class Type>
void agrees_with_generated_code() {
  for (const messages::Layout& layout : layouts()) {
    const Bytes bytes = sample<Type>(layout);
    const auto message = message_of<Type>(layout);
    EXPECT_EQ(message.utime, stamp.utime);
    EXPECT_EQ(message.run, stamp.run);
    EXPECT_EQ(message.tick, stamp.tick);
    EXPECT_EQ(lcm_bytes(message), bytes) << layout.num_joints << " joints";
    messages::Codec<typename Type::Value> codec(layout);
    messages::Stamp got;
    typename Type::Value value;
    ASSERT_EQ(codec.decode(bytes, got, value), messages::Rejection::none);
    const auto again = codec.encode(got, value);
    EXPECT_EQ(Bytes(again.begin(), again.end()), bytes) << layout.num_joints << " joints";
  }
}

/// Checks that no cut, flipped bit or appended byte crashes, and that accepted values are finite. A
/// rejected message must leave stamp and value unchanged.
template <class Type>
void survives_damage() {
  using messages::all_finite;
  for (const messages::Layout& layout : layouts()) {
    const messages::Codec<typename Type::Value> codec(layout);
    messages::Codec<typename Type::Value> writer(layout);
    const Bytes whole = sample<Type>(layout);
    messages::Stamp got;
    typename Type::Value value;
    ASSERT_EQ(codec.decode(whole, got, value), messages::Rejection::none);
    const auto untouched = [&] {
      const auto again = writer.encode(got, value);
      return std::equal(again.begin(), again.end(), whole.begin(), whole.end());
    };

    for (std::size_t size = 0; size < whole.size(); ++size) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      ASSERT_NE(codec.decode(cut, got, value), messages::Rejection::none) << "cut to " << size;
    }
    ASSERT_TRUE(untouched());
    Bytes longer = whole;
    longer.push_back(std::byte{0});
    ASSERT_EQ(codec.decode(longer, got, value), messages::Rejection::wrong_size);
    ASSERT_TRUE(untouched());

    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
      Bytes flipped = whole;
      flipped[bit / 8] ^= static_cast<std::byte>(1U << bit % 8);
      messages::Stamp flipped_stamp = got;
      typename Type::Value flipped_value = value;
      if (codec.decode(flipped, flipped_stamp, flipped_value) == messages::Rejection::none) {
        ASSERT_TRUE(all_finite(flipped_value)) << "bit " << bit;
      }
    }
  }
}

/// Checks that a non-finite value in any real of the message is found.
template <class Type>
void rejects_non_finite(std::size_t first_real, std::size_t num_reals,
                        const messages::Layout& layout) {
  for (std::size_t i = 0; i < num_reals; ++i) {
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::signaling_NaN(),
          std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
      Bytes bytes = sample<Type>(layout);
      overwrite_real(bytes, first_real + 8 * i, bad);
      EXPECT_EQ(verdict<Type>(layout, bytes), messages::Rejection::non_finite) << "real " << i;
    }
  }
}

/// Checks that a count that contradicts the layout is found, whatever length it implies.
template <class Type>
void rejects_counts(std::size_t offset, const messages::Layout& layout) {
  for (const std::int32_t count : {0x20000000, 0x7fffffff, -1, -0x7fffffff - 1, 3, 65}) {
    Bytes bytes = sample<Type>(layout);
    overwrite_int32(bytes, offset, count);
    EXPECT_EQ(verdict<Type>(layout, bytes), messages::Rejection::wrong_count) << count;
  }
}

template <class Type>
void rejects_other_fingerprint() {
  const messages::Layout layout{2, 2, 2};
  Bytes bytes = sample<Type>(layout);
  bytes[0] ^= std::byte{1};
  EXPECT_EQ(verdict<Type>(layout, bytes), messages::Rejection::wrong_type);
}

}  // namespace tachless::codec_checks
