#pragma once

#include <array>

#include "loop/signals.h"
#include "robot/quantities.h"

namespace tachless::plant {

/// What the drives do over one tick.
struct AppliedTorque {
  robot::Vector tau;                                ///< after the limit [N m; N if prismatic]
  std::array<bool, robot::max_joints> saturated{};  ///< the command exceeded the limit
};

/// The drives of all joints: they limit, delay and hold. A value: copies are independent. Once a
/// tick, in this order: `accept` the tick's command if there is one, read `applied`, `end_tick`.
///
/// With `command_delay` 0 the command of tick k acts over tick k; `applied` is then read after
/// `accept`. With 1 it acts over tick k + 1, the torque over the first tick is zero, and `applied`
/// may be read before the command has come. When no command comes the last one is held.
class Drive {
 public:
  /// @param limit [N m; N if prismatic], positive, `Model::unlimited` for none.
  /// @throw std::logic_error if `command_delay` is neither 0 nor 1 or a limit is not positive.
  Drive(const robot::Vector& limit, int command_delay);

  /// Takes the command of this tick. Returns false, and changes nothing, if a torque is not
  /// finite: the caller owes a protective stop.
  /// @throw std::logic_error if the command has the wrong number of joints.
  [[nodiscard]] bool accept(const loop::TorqueCommand& command);

  /// Torque held over this tick.
  [[nodiscard]] const AppliedTorque& applied() const { return applied_; }

  void end_tick();

  /// The protective stop: no torque from now on, whatever is accepted. (Braking is the arm's.)
  void stop();

 private:
  robot::Vector limit_;
  int command_delay_;
  bool stopped_ = false;
  AppliedTorque applied_;
  AppliedTorque accepted_;
};

}  // namespace tachless::plant
