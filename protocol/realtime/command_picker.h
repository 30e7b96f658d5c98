#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::realtime {

/// The controller's side: chooses the newest tick whose measurement and reference are both there,
/// once. Ticks may be skipped, and a skipped one is not computed later.
class CommandPicker {
 public:
  enum class Input { measurement, reference };
  CommandPicker(std::int64_t num_ticks, std::size_t longest_measurement,
                std::size_t longest_reference);

  lockstep::Verdict on_measurement(std::int64_t tick, std::span<const std::byte> bytes,
                                   std::string_view sender);
  lockstep::Verdict on_reference(std::int64_t tick, std::span<const std::byte> bytes,
                                 std::string_view sender);

  /// The tick to compute now; nothing when there is none newer than the last one.
  [[nodiscard]] std::optional<std::int64_t> due() const;
  /// The command of `tick`, which was due, is computed.
  void acted(std::int64_t tick);

  [[nodiscard]] std::span<const std::byte> measurement(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> reference(std::int64_t tick) const;
  /// Who sent the input that is kept for `tick`.
  [[nodiscard]] std::string_view sender_of(Input input, std::int64_t tick) const;

 private:
  std::int64_t num_ticks_;
  std::int64_t last_ = -1;    ///< newest tick computed
  std::int64_t newest_ = -1;  ///< newest measurement
  lockstep::MessageRing ring_;
};

}  // namespace tachless::protocol::realtime
