#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "base/quantities.h"
#include "messages/signals.h"
#include "plant/spec.h"

namespace tachless::plant {

/// Torque of the drives over one tick.
struct AppliedTorque {
  Vector tau;                                ///< torque after the limits [N m; N if prismatic]
  std::array<bool, max_joints> saturated{};  ///< the command exceeded a limit
};

/// The drives of all joints: they limit, delay and hold torques. Copies are independent. Call once
/// a tick, in this order: `accept` if the tick has a command, `applied`, `end_tick`.
///
/// With `command_delay` 0 the command of tick k acts over tick k; `applied` is then read after
/// `accept`. With d > 0 the command acts over tick k + d, and the initial torque over the first d
/// ticks. `applied` may then be read before the command has come. With jitter j the acting command
/// is up to j ticks older; a seeded generator draws its age for each tick. Without a command the
/// last one is held. From tick to tick the torque that is sent changes by at most its rate, from
/// the initial torque on. If the arm adds a torque itself, the difference is sent.
class Drive {
 public:
  /// @param spec its limits, jitter and seed are used
  /// @param command_delay [ticks]
  /// @param period_s one tick [s]
  /// @param initial torque of each joint until the first command acts [N m; N if prismatic]
  /// @throw std::logic_error if a delay is not in 0 to `max_delay_ticks` or a limit is not
  /// positive.
  Drive(const DriveSpec& spec, int command_delay, double period_s, const Vector& initial);

  /// Takes the command of this tick. Precondition: a finite torque of each joint.
  /// @throw std::logic_error if it is not; nothing changes then.
  void accept(const messages::TorqueCommand& command);

  /// Takes the torque that the arm itself adds over this tick [N m; N]: call it before `applied`
  /// is read. Until the first call the arm adds none.
  void set_added(const Vector& added);

  /// Returns the torque to send over this tick: `applied` without what the arm adds.
  [[nodiscard]] Vector sent() const { return applied_.tau - added_; }

  /// Returns the torque held over this tick.
  [[nodiscard]] const AppliedTorque& applied() const { return applied_; }

  void end_tick();

  /// Lets ticks pass in which nothing was sent and the robot held the last torque. Call it between
  /// `end_tick` and `applied`.
  void skip(std::int64_t ticks);

  /// Makes the protective stop: gives no torque from now on, whatever is accepted. The arm brakes.
  void stop();

 private:
  /// Begins the next slot with the last command.
  void shift();

  void act();

  Vector limit_;           ///< [N m; N if prismatic]
  Vector change_;          ///< largest change from one tick to the next [N m; N]; empty: no limit
  std::size_t num_slots_;  ///< command_delay + jitter + 1
  int jitter_;
  std::uint64_t seed_;
  std::int64_t tick_ = 0;
  bool stopped_ = false;
  /// A ring of accepted torques: this tick's at `now_`, behind it the oldest that may act, from
  /// command_delay + jitter ticks ago.
  std::array<AppliedTorque, 2 * max_delay_ticks + 1> accepted_;
  std::size_t now_ = 0;
  AppliedTorque applied_;
  Vector initial_;
  Vector added_;   ///< torque that the arm adds over this tick
  Vector before_;  ///< torque sent over the tick before
};

}  // namespace tachless::plant
