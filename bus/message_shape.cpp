#include "bus/message_shape.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace tachless::bus {
namespace {

constexpr std::size_t header_size = 4 * sizeof(std::int64_t);  // fingerprint, utime, run, tick
constexpr std::size_t length_size = sizeof(std::int32_t);

std::uint64_t big_endian(const std::byte* bytes, std::size_t size) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < size; ++i) {
    value = value << 8 | std::to_integer<std::uint64_t>(bytes[i]);
  }
  return value;
}

std::int32_t int32_at(const std::byte* bytes) {
  return static_cast<std::int32_t>(big_endian(bytes, sizeof(std::int32_t)));
}

/// IEEE 754: an exponent of all ones is infinity or NaN.
bool finite_at(const std::byte* bytes) {
  constexpr std::uint64_t exponent = 0x7ff0'0000'0000'0000;
  return (big_endian(bytes, sizeof(double)) & exponent) != exponent;
}

std::size_t smallest_size(const Field& field) {
  const auto number = static_cast<std::size_t>(field.number);
  switch (field.kind) {
    case Field::Kind::int64:
    case Field::Kind::real:
      return 8 * number;
    case Field::Kind::int32:
      return 4 * number;
    case Field::Kind::int8:
    case Field::Kind::boolean:
      return number;
    case Field::Kind::count:
      return 4;
    case Field::Kind::text:
      return length_size + 1;
  }
  return 0;
}

std::size_t largest_size(const Field& field) {
  const std::size_t characters =
      field.kind == Field::Kind::text ? static_cast<std::size_t>(field.number) : 0;
  return smallest_size(field) + characters;
}

}  // namespace

MessageShape::MessageShape(std::int64_t fingerprint, std::vector<Field> fields,
                           std::size_t max_size)
    : fingerprint_(fingerprint),
      fields_(std::move(fields)),
      min_size_(header_size),
      max_size_(header_size) {
  for (const Field& field : fields_) {
    min_size_ += smallest_size(field);
    max_size_ += largest_size(field);
  }
  if (max_size != 0) max_size_ = std::min(max_size_, max_size);
}

Rejection MessageShape::check(std::span<const std::byte> payload) const {
  if (payload.size() < min_size_ || payload.size() > max_size_) return Rejection::wrong_size;
  const std::byte* at = payload.data();
  const std::byte* const end = at + payload.size();
  if (static_cast<std::int64_t>(big_endian(at, 8)) != fingerprint_) return Rejection::wrong_type;
  at += header_size;

  // Bytes that the fields not yet visited need at least: a text may not eat into them.
  std::size_t needed = min_size_ - header_size;
  for (const Field& field : fields_) {
    const std::size_t size = smallest_size(field);
    needed -= size;
    switch (field.kind) {
      case Field::Kind::int64:
      case Field::Kind::int32:
      case Field::Kind::int8:
        break;
      case Field::Kind::boolean:
        for (int i = 0; i < field.number; ++i) {
          if (std::to_integer<unsigned>(at[i]) > 1) return Rejection::bad_value;
        }
        break;
      case Field::Kind::real:
        for (int i = 0; i < field.number; ++i) {
          if (!finite_at(at + 8 * i)) return Rejection::non_finite;
        }
        break;
      case Field::Kind::count:
        if (int32_at(at) != field.number) return Rejection::wrong_count;
        break;
      case Field::Kind::text: {
        const std::int32_t length = int32_at(at);  // with the NUL
        if (length < 1 || length - 1 > field.number) return Rejection::bad_text;
        const auto available = static_cast<std::size_t>(end - at) - length_size - needed;
        const auto extent = static_cast<std::size_t>(length);
        if (extent > available) return Rejection::bad_text;
        const void* nul = std::memchr(at + length_size, 0, extent);
        if (nul != at + length_size + extent - 1) return Rejection::bad_text;
        at += extent - 1;
        break;
      }
    }
    at += size;
  }
  return at == end ? Rejection::none : Rejection::wrong_size;
}

}  // namespace tachless::bus
