#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "loop/messages.h"

/// Domain value <-> message bytes, with every check done before anything is decoded. Neither
/// subscribes nor computes.
namespace tachless::bus {

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

/// Fingerprint and stamp, with which every message begins [bytes].
inline constexpr std::size_t stamp_end = 8 + 3 * sizeof(std::int64_t);

/// The stamp of a message that a codec found to have the right shape (`none` or `non_finite`).
/// @throw std::logic_error when the bytes are too few to hold one.
loop::Stamp stamp_of(std::span<const std::byte> payload);

/// True when no number in the value is NaN or infinite. A node asks before it encodes what it
/// has computed, and stops with a fault of its own if the answer is no.
bool all_finite(const loop::Tick& value);
bool all_finite(const loop::PositionMeasurement& value);
bool all_finite(const loop::MotorPositionMeasurement& value);
bool all_finite(const loop::LinkStateMeasurement& value);
bool all_finite(const loop::StateMeasurement& value);
bool all_finite(const loop::ReferencePoint& value);
bool all_finite(const loop::TorqueCommand& value);
bool all_finite(const loop::LawSignals& value);
bool all_finite(const loop::Participant& value);
bool all_finite(const loop::RunInfo& value);
bool all_finite(const loop::LogAck& value);

/// Encoder and decoder of one message type for one layout. Owns its scratch memory, so that
/// fixed-size messages cost no allocation after construction. Explicitly instantiated for the
/// types above (and in bus/truth for PlantTruth).
/// One codec serves one thread at a time.
template <class Value>
class Codec {
 public:
  /// @throw std::logic_error if the message has joint arrays and the layout does not hold 1 to
  /// loop::max_joints joints, as many motors or none, and 0 to loop::max_signals signals
  explicit Codec(const loop::Layout& layout);
  ~Codec();
  Codec(Codec&&) noexcept;
  Codec& operator=(Codec&&) noexcept;

  /// The message's bytes; valid until the next call. Precondition: sizes agree with the layout,
  /// `all_finite(value)`, single fields in their range, texts short enough and without NUL.
  /// @throw std::domain_error if a number is NaN or infinite
  /// @throw std::length_error if a text, or the whole message, is too long for its message type
  /// @throw std::logic_error if anything else of the precondition is broken (base of both)
  std::span<const std::byte> encode(const loop::Stamp& stamp, const Value& value);

  /// Bytes of the longest message there is; of every one, if the type holds no text.
  [[nodiscard]] std::size_t longest() const;

  /// Checks first (size, fingerprint, counts, finiteness, texts), then decodes. On rejection
  /// `stamp` and `value` are untouched. Does not look at run or tick: that is the node's.
  Rejection decode(std::span<const std::byte> payload, loop::Stamp& stamp, Value& value) const;

 private:
  struct Scratch;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace tachless::bus
