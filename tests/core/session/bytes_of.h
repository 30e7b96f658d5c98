#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

/// The bytes of a number, as a message.
struct BytesOf {
  explicit BytesOf(std::uint64_t value) { std::memcpy(bytes, &value, sizeof value); }
  operator std::span<const std::byte>() const { return bytes; }  // NOLINT: a test's shorthand
  std::byte bytes[sizeof(std::uint64_t)];
};

inline std::uint64_t number_in(std::span<const std::byte> bytes) {
  std::uint64_t value = 0;
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}
