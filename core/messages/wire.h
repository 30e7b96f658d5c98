#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/measurements.h"

/// Conversion of messages to bytes of LCM and back, by the tables of fields in
/// core/messages/messages.h. Every length and count is checked before it is used. This header
/// neither subscribes nor computes.
namespace tachless::messages {

/// Reason for which a datagram is rejected. Nothing is decoded unless it is `none`.
enum class Rejection {
  none,
  wrong_size,   ///< not exactly the length of the expected type with the run's joint count
  wrong_type,   ///< the LCM fingerprint is another type's
  wrong_count,  ///< an array count inside contradicts the length
  non_finite,   ///< a double is NaN or infinite
  bad_text,     ///< a string's length or terminator is wrong
  bad_value,    ///< a field is outside its documented range
};
std::string_view name(Rejection rejection);

/// Fingerprint, utime, run and tick, with which every message begins [bytes].
inline constexpr std::size_t stamp_end = 4 * sizeof(std::int64_t);

/// Returns the fingerprint if there are enough bytes for one.
std::optional<std::int64_t> fingerprint_of(std::span<const std::byte> payload);

/// Returns the stamp of a message of at least `stamp_end` bytes. The numbers are arbitrary if no
/// codec has checked the message.
/// @throw std::logic_error if there are too few bytes.
messages::Stamp stamp_of(std::span<const std::byte> payload);

/// Returns LCM's hash of the type of `Value`'s message, as lcm-gen computes it. It is instantiated
/// for messages::Messages and, in messages/truth, for the types of that folder.
template <class Value>
std::int64_t fingerprint();

/// Returns the layout that the message's counts announce, if that layout is possible. Returns {1,
/// 0, 0} if the type has no counts. It checks nothing else and serves readers that do not know the
/// run.
template <class Value>
std::optional<messages::Layout> announced_layout(std::span<const std::byte> payload);

using messages::all_finite;

/// Encoder and decoder of one message type for one layout. Its memory is preallocated, so
/// fixed-size messages cost no allocation after construction. It is instantiated for
/// messages::Messages and, in messages/truth, for the types of that folder. Only one thread at a
/// time may use a codec.
template <class Value>
class Codec {
 public:
  /// @throw std::logic_error if the message has joint arrays and the layout is not possible. A
  /// possible layout has 1 to max_joints joints, as many motors or none, and 0 to
  /// messages::max_signals signals.
  explicit Codec(const messages::Layout& layout);

  /// Returns the message's bytes, valid until the next call. Precondition: sizes agree with the
  /// layout, `all_finite(value)` holds, single fields are in their range, and texts are short
  /// enough and without NUL.
  /// @throw std::domain_error if a number is NaN or infinite
  /// @throw std::length_error if a text, or the whole message, is too long for its message type
  /// @throw std::logic_error if another part of the precondition is violated (base of both)
  std::span<const std::byte> encode(const messages::Stamp& stamp, const Value& value);

  /// Returns the number of bytes of the longest message. Without a text all messages have this
  /// length.
  [[nodiscard]] std::size_t longest() const { return bytes_.size(); }

  /// Checks and decodes in one pass: size, fingerprint, then the fields in order. On rejection
  /// `stamp` and `value` are unchanged. The function does not check run and tick; the node does.
  Rejection decode(std::span<const std::byte> payload, messages::Stamp& stamp, Value& value) const;

 private:
  messages::Layout layout_;
  std::size_t min_size_;
  std::vector<std::byte> bytes_;  ///< last encoded message; sized for the longest
  /// Target of decoding, so that a rejected message changes nothing.
  std::unique_ptr<Value> scratch_;
};

/// Codec of the measurement that a channel suffix names; it decodes values of that type.
template <>
class Codec<messages::AnyMeasurement> {
 public:
  /// Precondition: the suffix names a measurement.
  /// @throw std::logic_error as the other codecs
  Codec(std::string_view suffix, const messages::Layout& layout);

  /// Encodes as the other codecs. Precondition: `value` has the suffix's type, and the other
  /// codecs' preconditions.
  std::span<const std::byte> encode(const messages::Stamp& stamp,
                                    const messages::AnyMeasurement& value);
  [[nodiscard]] std::size_t longest() const;
  Rejection decode(std::span<const std::byte> payload, messages::Stamp& stamp,
                   messages::AnyMeasurement& value) const;

 private:
  messages::EachMeasurement<Codec> codec_;
};

/// The channel of one type of message, and its codec.
template <class Value>
struct Port {
  std::string channel;
  Codec<Value> codec;
};
template <class Value>
Port<Value> port(std::string_view robot, const messages::Layout& layout) {
  return {messages::channel<Value>(robot), Codec<Value>(layout)};
}

}  // namespace tachless::messages
