#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "protocol/lockstep/message_ring.h"

namespace tachless::protocol::realtime {

/// The plant's side: accepts a command only within its tick, counts the ticks without a command and
/// reports when too many in a row had none. Does not hold the torque or stop the robot: the plant
/// does.
class MissedCommandMonitor {
 public:
  /// @param max_missed commands that may be missed in a row
  MissedCommandMonitor(int max_missed, std::size_t longest_command);

  void begin(std::int64_t tick);

  /// A command of this run. `fresh`: the first of the present tick; `too_old`: of a tick that is
  /// over; `not_asked`: of a tick that has not begun.
  lockstep::Verdict on_command(std::int64_t tick, std::span<const std::byte> bytes,
                               std::string_view sender);
  /// Whether this tick's command was received.
  [[nodiscard]] bool commanded() const { return commanded_; }
  /// Who sent the command that is kept for `tick`.
  [[nodiscard]] std::string_view sender_of(std::int64_t tick) const;

  /// The tick is over.
  void end();

  [[nodiscard]] std::int64_t missed() const { return missed_; }  ///< ticks without a command
  [[nodiscard]] std::int64_t missed_in_a_row() const { return in_a_row_; }  ///< at present
  [[nodiscard]] std::int64_t longest_miss() const { return longest_; }      ///< most in a row
  /// More than `max_missed` in a row: the protective stop is due.
  [[nodiscard]] bool too_many() const { return in_a_row_ > max_missed_; }

 private:
  int max_missed_;
  lockstep::MessageRing commands_;
  std::int64_t tick_ = -1;
  bool commanded_ = false;
  std::int64_t missed_ = 0;
  std::int64_t in_a_row_ = 0;
  std::int64_t longest_ = 0;
};

}  // namespace tachless::protocol::realtime
