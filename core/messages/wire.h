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

/// Values of loop/ as bytes of LCM messages and back, after the tables of fields in
/// core/messages/messages.h; every length and count is checked before it is believed. Neither
/// subscribes nor computes.
namespace tachless::messages {

/// Why a datagram was not accepted. Nothing is decoded from one that is not `none`.
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

/// The fingerprint, if the bytes are enough to hold one.
std::optional<std::int64_t> fingerprint_of(std::span<const std::byte> payload);

/// The stamp of a message of at least `stamp_end` bytes; anything of one that no codec has checked.
/// @throw std::logic_error when the bytes are too few to hold one.
messages::Stamp stamp_of(std::span<const std::byte> payload);

/// LCM's hash of the type of `Value`'s message, as lcm-gen computes it. Instantiated for
/// messages::Messages (and in bus/truth for PlantTruth).
template <class Value>
std::int64_t fingerprint();

/// The layout that the counts of a message announce, if a message can have it; {1, 0, 0} when its
/// type has no counts. Looks at nothing else: for readers that do not know the run.
template <class Value>
std::optional<messages::Layout> announced_layout(std::span<const std::byte> payload);

using messages::all_finite;

/// Encoder and decoder of one message type for one layout. Preallocated, so that
/// fixed-size messages cost no allocation after construction. Explicitly instantiated for
/// messages::Messages (and in bus/truth for PlantTruth).
/// One codec serves one thread at a time.
template <class Value>
class Codec {
 public:
  /// @throw std::logic_error if the message has joint arrays and the layout does not hold 1 to
  /// max_joints joints, as many motors or none, and 0 to messages::max_signals signals
  explicit Codec(const messages::Layout& layout);

  /// The message's bytes; valid until the next call. Precondition: sizes agree with the layout,
  /// `all_finite(value)`, single fields in their range, texts short enough and without NUL.
  /// @throw std::domain_error if a number is NaN or infinite
  /// @throw std::length_error if a text, or the whole message, is too long for its message type
  /// @throw std::logic_error if anything else of the precondition is broken (base of both)
  std::span<const std::byte> encode(const messages::Stamp& stamp, const Value& value);

  /// Bytes of the longest message there is; of every one, if the type holds no text.
  [[nodiscard]] std::size_t longest() const { return bytes_.size(); }

  /// Checks and decodes in one pass: size, fingerprint, then the fields in turn. On rejection
  /// `stamp` and `value` are untouched. Does not look at run or tick: that is the node's.
  Rejection decode(std::span<const std::byte> payload, messages::Stamp& stamp, Value& value) const;

 private:
  messages::Layout layout_;
  std::size_t min_size_;
  std::vector<std::byte> bytes_;    ///< of the message encoded last; as long as the longest
  std::unique_ptr<Value> scratch_;  ///< decoded into, so that a rejected message changes nothing
};

/// Of the measurement that a channel suffix names: what is decoded is one of that type.
template <>
class Codec<messages::AnyMeasurement> {
 public:
  /// Precondition: there is such a measurement. @throw std::logic_error as the others
  Codec(std::string_view suffix, const messages::Layout& layout);

  /// Precondition: `value` is of that type, and as the others.
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
