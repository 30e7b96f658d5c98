#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "bus/wire.h"

namespace tachless::monitor {

/// One field of a message, named as in its .lcm file.
struct MessageField {
  std::string name;       ///< with the row, "value[0]", of a law's signals
  std::string_view unit;  ///< of revolute joints; empty when there is none
  std::variant<std::vector<double>, double, std::int64_t, bool, std::string> value;
};

/// Reads every type of ours without knowing the run: joints, motors and signals are counted as the
/// message itself announces, which is believed only when its size is exactly that of such a
/// message and every further check of the wire agrees. A tag at the end (bus/authenticated.h) is
/// noticed and not verified: that needs the key.
class MessageReader {
 public:
  /// What a message is, at a glance.
  struct Glance {
    std::string_view type;  ///< "tachless.tick_t"; empty when not ours, and then no more is known
    bus::Rejection rejection = bus::Rejection::none;
    loop::Stamp stamp;           ///< when not rejected
    bool tagged = false;         ///< by the holder of a key, or so it seems
    bool once_per_tick = false;  ///< the type is sent for every tick of a run
  };

  MessageReader();
  MessageReader(const MessageReader&) = delete;
  MessageReader& operator=(const MessageReader&) = delete;
  ~MessageReader();

  Glance glance(std::span<const std::byte> message);

  /// All fields after utime, run and tick. Precondition: `glance` has type and no rejection.
  std::vector<MessageField> fields(std::span<const std::byte> message);

 private:
  class OfType;
  template <class Value>
  class Reader;

  [[nodiscard]] OfType* reader_of(std::string_view type) const;

  std::vector<std::unique_ptr<OfType>> readers_;
};

}  // namespace tachless::monitor
