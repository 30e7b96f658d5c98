#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>

#include "messages/wire.h"

/// The members of `Codec`: loops over a message's table of fields. Only the two files that
/// instantiate them include this header (wire.cpp, truth/truth_wire.cpp).
///
/// The bytes have LCM's format: the type's fingerprint, then every field in order, big-endian. A
/// text consists of an int32 length that counts the NUL, the characters, and the NUL. An array has
/// no length of its own; a count before it gives the length.
namespace tachless::messages::detail {

using messages::Count;
using messages::Kind;
using SignalRows = decltype(messages::LawSignals::value);

constexpr std::size_t count_size = sizeof(std::int32_t);
constexpr std::size_t smallest_text = count_size + 1;

template <class Member>
concept Text = std::is_same_v<Member, std::string> || std::is_same_v<Member, messages::Role>;

constexpr std::uint64_t big_endian(std::uint64_t value) {
  return std::endian::native == std::endian::little ? __builtin_bswap64(value) : value;
}

class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : left_(bytes) {}

  /// Returns the next `size` bytes, 1 to 8, as an unsigned number. Precondition: at least `size`
  /// bytes are left.
  std::uint64_t take(std::size_t size) {
    std::uint64_t value = 0;
    std::memcpy(&value, left_.data(), size);
    left_ = left_.subspan(size);
    return big_endian(value) >> 8 * (8 - size);
  }
  std::int64_t int64() { return static_cast<std::int64_t>(take(8)); }
  std::int32_t int32() { return static_cast<std::int32_t>(take(4)); }
  std::string_view characters(std::size_t size) {
    const std::string_view text(reinterpret_cast<const char*>(left_.data()), size);
    left_ = left_.subspan(size);
    return text;
  }
  [[nodiscard]] std::size_t left() const { return left_.size(); }

 private:
  std::span<const std::byte> left_;
};

class Writer {
 public:
  explicit Writer(std::span<std::byte> bytes) : left_(bytes) {}

  void put(std::uint64_t value, std::size_t size) {
    value = big_endian(value << 8 * (8 - size));
    std::memcpy(left_.data(), &value, size);
    left_ = left_.subspan(size);
  }
  void characters(std::string_view text) {
    std::memcpy(left_.data(), text.data(), text.size());
    left_ = left_.subspan(text.size());
  }

 private:
  std::span<std::byte> left_;
};

constexpr std::size_t size_of(Kind kind) {
  switch (kind) {
    case Kind::real:
    case Kind::int64:
      return 8;
    case Kind::int32:
      return 4;
    case Kind::flag:
    case Kind::int8:
    case Kind::uint8:
      return 1;
    case Kind::text:
      break;
  }
  return smallest_text;
}

/// Returns the number of entries of one row.
constexpr int length_of(Count count, const messages::Layout& layout) {
  if (count == Count::one) return 1;
  if (count == Count::roles) return messages::num_roles;
  return count == Count::motors ? layout.num_motors : layout.num_joints;
}

template <class Field>
constexpr std::size_t smallest_size(const Field& field, const messages::Layout& layout) {
  const int rows = field.count == Count::signals ? layout.num_signals : 1;
  return size_of(field.kind) * static_cast<std::size_t>(rows * length_of(field.count, layout));
}

/// Calls `f(expected)` for each count at the message's beginning, in order.
template <class Value, class F>
void for_each_count(const messages::Layout& layout, F&& f) {
  if constexpr (messages::has_count<Value>(Count::signals)) f(layout.num_signals);
  if constexpr (messages::has_joint_count<Value>()) f(layout.num_joints);
  if constexpr (messages::has_count<Value>(Count::motors)) f(layout.num_motors);
}

inline std::string_view view(const std::string& text) { return text; }
inline std::string_view view(messages::Role role) { return messages::name(role); }
inline bool assign(std::string_view text, std::string& to) {
  to = text;
  return true;
}
inline bool assign(std::string_view text, messages::Role& to) {
  for (int i = 0; i < messages::num_roles; ++i) {
    to = static_cast<messages::Role>(i);
    if (name(to) == text) return true;
  }
  return false;
}

/// Calls `f(entry)` for each number of a field, in the order of the message. Precondition: sizes
/// agree with the layout.
template <class Field, class Member, class F>
void for_each_entry(const Field& field, const messages::Layout& layout, Member& member, F&& f) {
  const auto length = static_cast<std::size_t>(length_of(field.count, layout));
  if constexpr (std::is_same_v<std::remove_const_t<Member>, SignalRows>) {
    for (std::size_t row = 0; row < static_cast<std::size_t>(layout.num_signals); ++row) {
      for (auto& entry : member[row]) f(entry);
    }
  } else if constexpr (requires { member[length]; }) {
    for (std::size_t i = 0; i < length; ++i) f(member[static_cast<std::ptrdiff_t>(i)]);
  } else {
    f(member);
  }
}

// The reading functions take a field from `from`, which must hold it, and return why the field is
// rejected.

template <class Field, class Entry>
Rejection read_entry(Reader& from, const Field& field, Entry& to) {
  double number = 0;
  if constexpr (std::is_same_v<Entry, double>) {
    // The exponent of infinity and NaN has all bits set.
    constexpr std::uint64_t exponent = 0x7ff0'0000'0000'0000;
    const std::uint64_t bits = from.take(8);
    to = number = std::bit_cast<double>(bits);
    if ((bits & exponent) == exponent) return Rejection::non_finite;
  } else {
    const std::uint64_t bits = from.take(size_of(field.kind));
    auto whole = static_cast<std::int64_t>(bits);
    if (field.kind == Kind::int32) whole = static_cast<std::int32_t>(bits);
    if (field.kind == Kind::int8) whole = static_cast<std::int8_t>(bits);
    if (field.kind == Kind::flag && whole > 1) return Rejection::bad_value;
    to = static_cast<Entry>(whole);
    number = static_cast<double>(whole);
  }
  return number < field.lowest || number > field.highest ? Rejection::bad_value : Rejection::none;
}

/// Resizes and clears `member`, so that nothing of an earlier message remains. Does not allocate:
/// Vector resizes in place.
template <class Field, class Member>
void make_room(const Field& field, const messages::Layout& layout, Member& member) {
  if constexpr (std::is_same_v<Member, Vector>) {
    member.resize(length_of(field.count, layout));
  } else if constexpr (std::is_same_v<Member, SignalRows>) {
    for (int row = 0; row < messages::max_signals; ++row) {
      member[static_cast<std::size_t>(row)].resize(row < layout.num_signals ? layout.num_joints
                                                                            : 0);
    }
  } else {
    member = {};
  }
}

/// Returns whether a text has no control characters, which a terminal or another program would
/// obey. A file may have line ends and tabs.
template <class Field>
bool is_clean(const Field& field, std::string_view text) {
  const auto bad = [&](char c) {
    return c == 0x7f || (static_cast<unsigned char>(c) < 0x20 &&
                         !(field.lines && (c == '\n' || c == '\t' || c == '\r')));
  };
  if (std::any_of(text.begin(), text.end(), bad)) return false;
  return field.name != "signals" || messages::are_signals(text);
}

/// Reads a field.
/// @param needed bytes that the later fields need at least; a text may not extend into them
template <class Field, class Member>
Rejection read(Reader& from, const Field& field, const messages::Layout& layout,
               std::size_t /*needed*/, Member& to) {
  Rejection result = Rejection::none;
  make_room(field, layout, to);
  for_each_entry(field, layout, to, [&](auto& entry) {
    if (result == Rejection::none) result = read_entry(from, field, entry);
  });
  return result;
}
template <class Field>
Rejection read(Reader& from, const Field& field, const messages::Layout& /*layout*/,
               std::size_t needed, Text auto& to) {
  const std::int32_t length = from.int32();
  if (length < 1) return Rejection::bad_text;
  const auto extent = static_cast<std::size_t>(length);  // with the NUL
  if (extent - 1 > field.longest || extent > from.left() - needed) return Rejection::bad_text;
  const std::string_view text = from.characters(extent);
  if (text.find('\0') != extent - 1) return Rejection::bad_text;
  const std::string_view without_nul = text.substr(0, extent - 1);
  if (!is_clean(field, without_nul)) return Rejection::bad_text;
  return assign(without_nul, to) ? Rejection::none : Rejection::bad_value;
}

// The requiring functions throw std::logic_error if a value could not be read back. They return the
// number of bytes that the value needs beyond its smallest size.

template <class Field, class Member>
std::size_t require(const Field& field, const messages::Layout& layout, const Member& member) {
  const auto require_size = [&](const Vector& vector, int size) {
    if (vector.size() == size) return;
    throw std::logic_error(fmt::format("messages::Codec: {} has {} entries, the layout says {}",
                                       field.symbol, vector.size(), size));
  };
  if constexpr (std::is_same_v<Member, Vector>) {
    require_size(member, length_of(field.count, layout));
  } else if constexpr (std::is_same_v<Member, SignalRows>) {
    for (std::size_t row = 0; row < static_cast<std::size_t>(layout.num_signals); ++row) {
      require_size(member[row], layout.num_joints);
    }
  } else if constexpr (requires { static_cast<double>(member); }) {
    const auto number = static_cast<double>(member);
    if (number < field.lowest || number > field.highest) {
      throw std::logic_error(fmt::format("messages::Codec: {} is {}, allowed are {} to {}",
                                         field.name, number, field.lowest, field.highest));
    }
  }
  return 0;
}
template <class Field>
std::size_t require(const Field& field, const messages::Layout& /*layout*/,
                    const Text auto& member) {
  const std::string_view text = view(member);
  if (!is_clean(field, text)) {
    throw std::logic_error(
        fmt::format("messages::Codec: {} holds a control character, or is not name:unit,…: \"{}\"",
                    field.name, text));
  }
  if (text.size() > field.longest) {
    throw std::length_error(
        fmt::format("messages::Codec: text {} has {} characters, allowed are {}", field.name,
                    text.size(), field.longest));
  }
  return text.size();
}

// The writing functions append a field to `to`.

template <class Field, class Member>
void write(Writer& to, const Field& field, const messages::Layout& layout, const Member& member) {
  for_each_entry(field, layout, member, [&]<class Entry>(const Entry& entry) {
    if constexpr (std::is_same_v<Entry, double>) {
      to.put(std::bit_cast<std::uint64_t>(entry), 8);
    } else {
      to.put(static_cast<std::uint64_t>(entry), size_of(field.kind));
    }
  });
}
template <class Field>
void write(Writer& to, const Field& /*field*/, const messages::Layout& /*layout*/,
           const Text auto& member) {
  to.put(view(member).size() + 1, count_size);
  to.characters(view(member));
  to.put(0, 1);
}

constexpr bool possible(const messages::Layout& layout) {
  return layout.num_joints >= 1 && layout.num_joints <= max_joints &&
         (layout.num_motors == 0 || layout.num_motors == layout.num_joints) &&
         layout.num_signals >= 0 && layout.num_signals <= messages::max_signals;
}

inline void require_layout(const messages::Layout& layout) {
  if (possible(layout)) return;
  throw std::logic_error(fmt::format(
      "messages::Codec: impossible layout: num_joints {}, num_motors {}, num_signals {}",
      layout.num_joints, layout.num_motors, layout.num_signals));
}

}  // namespace tachless::messages::detail

namespace tachless::messages {

template <class Value>
Codec<Value>::Codec(const messages::Layout& layout)
    : layout_(layout), min_size_(stamp_end), scratch_(std::make_unique<Value>()) {
  if constexpr (messages::has_joint_count<Value>()) detail::require_layout(layout);
  detail::for_each_count<Value>(layout, [&](int) { min_size_ += detail::count_size; });
  std::size_t max_size = min_size_;
  messages::for_each_field<Value>([&](const auto& field) {
    const std::size_t size = detail::smallest_size(field, layout);
    min_size_ += size;
    max_size += size + field.longest;
  });
  if constexpr (requires { Value::max_size; }) {
    max_size = std::min(max_size, Value::max_size);
  }
  bytes_.resize(max_size);
}

template <class Value>
std::span<const std::byte> Codec<Value>::encode(const messages::Stamp& stamp, const Value& value) {
  constexpr std::string_view suffix = Value::suffix;
  if (!all_finite(value)) {
    throw std::domain_error(
        fmt::format("messages::Codec: NaN or infinity in a message for channel …_{}", suffix));
  }
  if constexpr (requires { value.num; }) {
    if (value.num != layout_.num_signals) {
      throw std::logic_error(fmt::format("messages::Codec: {} signals, the layout says {}",
                                         value.num, layout_.num_signals));
    }
  }
  std::size_t size = min_size_;
  messages::for_each_field<Value>(
      [&](const auto& field) { size += detail::require(field, layout_, value.*field.member); });
  if (size > bytes_.size()) {
    throw std::length_error(
        fmt::format("messages::Codec: message for channel …_{} has {} bytes, allowed are {}",
                    suffix, size, bytes_.size()));
  }

  detail::Writer to(bytes_);
  for (const std::int64_t each : {fingerprint<Value>(), stamp.utime, stamp.run, stamp.tick}) {
    to.put(static_cast<std::uint64_t>(each), 8);
  }
  detail::for_each_count<Value>(
      layout_, [&](int count) { to.put(static_cast<std::uint64_t>(count), detail::count_size); });
  messages::for_each_field<Value>(
      [&](const auto& field) { detail::write(to, field, layout_, value.*field.member); });
  return {bytes_.data(), size};
}

template <class Value>
Rejection Codec<Value>::decode(std::span<const std::byte> payload, messages::Stamp& stamp,
                               Value& value) const {
  if (payload.size() < min_size_ || payload.size() > bytes_.size()) return Rejection::wrong_size;
  if (fingerprint_of(payload) != fingerprint<Value>()) return Rejection::wrong_type;
  detail::Reader from(payload.subspan(stamp_end));
  Rejection result = Rejection::none;
  std::size_t needed = min_size_ - stamp_end;
  detail::for_each_count<Value>(layout_, [&](int count) {
    if (result == Rejection::none && from.int32() != count) result = Rejection::wrong_count;
    needed -= detail::count_size;
  });
  messages::for_each_field<Value>([&](const auto& field) {
    if (result != Rejection::none) return;
    needed -= detail::smallest_size(field, layout_);
    result = detail::read(from, field, layout_, needed, (*scratch_).*field.member);
  });
  if (result != Rejection::none) return result;
  if (from.left() != 0) return Rejection::wrong_size;
  const messages::Stamp read = stamp_of(payload);
  if (read.utime < 0 || read.utime > messages::Stamp::max_utime) return Rejection::bad_value;
  if constexpr (requires { value.num; }) scratch_->num = layout_.num_signals;
  stamp = read;
  value = *scratch_;
  return Rejection::none;
}

template <class Value>
std::optional<messages::Layout> announced_layout(std::span<const std::byte> payload) {
  messages::Layout layout{1, 0, 0};
  if constexpr (messages::has_joint_count<Value>()) {
    constexpr bool signals = messages::has_count<Value>(messages::Count::signals);
    constexpr bool motors = messages::has_count<Value>(messages::Count::motors);
    if (payload.size() < stamp_end + detail::count_size * (1U + signals + motors)) return {};
    detail::Reader from(payload.subspan(stamp_end));
    if (signals) layout.num_signals = from.int32();
    layout.num_joints = from.int32();
    if (motors) layout.num_motors = from.int32();
    if (!detail::possible(layout)) return {};
  }
  return layout;
}

}  // namespace tachless::messages
