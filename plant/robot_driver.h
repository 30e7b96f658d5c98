#pragma once

#include <string>
#include <vector>

#include "base/failure.h"
#include "base/quantities.h"
#include "plant/arm_state.h"

namespace tachless::plant {

/// Failure that a driver's `stop` throws if it cannot confirm the stop, for example over a lost
/// link, and the robot stops by itself. The text names what makes the robot stop. The loop does not
/// call `stop` again.
class StopsByItself : public base::Failure {
 public:
  /// @param what makes the robot stop, one line
  explicit StopsByItself(std::string_view what) : Failure(base::ExitCode::protective_stop, what) {}
};

/// A number that a driver counted or measured in a run, for summary.json and the closing table.
struct DriverFigure {
  std::string name;  ///< name with the unit: "temperature_joint_3_C"
  double value = 0;  ///< the number, in the unit of the name
};

/// A robot as the loop needs it: the emulator, or the driver of a real robot (docs/real_robot.md).
/// One thread makes all calls. The order is: `start` once; then, tick by tick, `read` and `hold`.
/// At the end of every run that came as far as `start`, good or bad, the loop calls `stop` once. It
/// then calls `rest` about once a tick until the process ends, and `figures` once.
///
/// A driver reports a fault by throwing base::Failure(protective_stop), whose text the user reads.
/// Any exception stops the robot. Only `start` may take long, because the other calls use the
/// loop's time. `read` and `hold` allocate nothing.
class RobotDriver {
 public:
  virtual ~RobotDriver() = default;

  /// Returns true if `read` measures velocities. If not, laws that need them are refused, and the
  /// velocities that `read` gives are for the log alone.
  [[nodiscard]] virtual bool measures_velocity() const = 0;

  /// Returns true if the robot is the clock: its tick is over, and the next one begins, when
  /// `hold` returns.
  [[nodiscard]] virtual bool is_clock() const { return false; }

  /// Enables the drives. All processes have joined then, and the first tick follows within
  /// milliseconds.
  virtual void start() = 0;

  /// Returns the state at the beginning of a tick. Velocities are measured, or estimated by the
  /// driver. The loop may call `read` before `start`. If the robot does not answer in time, the
  /// driver returns a state that is `missing`. The loop then holds the last torque over the tick,
  /// and no law steps. More than loop.max_missed such ticks in a row are a protective stop. A
  /// driver that knows the cause throws earlier.
  virtual ArmState read() = 0;

  /// Applies a motor torque [N m; N if prismatic] from now on, within the limits. The torque is in
  /// the driver's signs (robot.joint_signs), without the torque that the arm adds itself
  /// (robot.compensates). The tick ends `until_s` after the start of the run. An emulator
  /// integrates to `until_s`; a real robot moves by itself.
  virtual void hold(const Vector& tau, double until_s) = 0;

  /// Makes the protective stop, also at the end of the run: no torque any more, brakes closed.
  /// Returns at once, while the robot still comes to rest. The loop calls it again if it throws,
  /// unless it throws `StopsByItself`.
  virtual void stop() = 0;

  /// Replaces `hold` in a tick of a robot that is stopped, or that gets no command from
  /// `commission`. After the run the loop calls it about once a tick until the process ends. A
  /// driver whose robot holds itself by commands keeps the robot in place. An emulator's time goes
  /// on to `until_s`.
  virtual void rest(double until_s) { static_cast<void>(until_s); }

  /// Returns what the driver counted and measured in this run. The loop calls it after `stop`.
  [[nodiscard]] virtual std::vector<DriverFigure> figures() const { return {}; }
};

/// A robot whose own controller is the clock (KUKA's FRI, libfranka). Once in each of its ticks the
/// controller sends its measurement and takes a torque. The loop's ticks begin at these times. With
/// `time_s` the loop counts the ticks by the robot's own time. A tick with a lost state is a missed
/// tick.
class ClockDriver : public RobotDriver {
 public:
  [[nodiscard]] bool is_clock() const final { return true; }
  ArmState read() final {
    if (!fresh_) now_ = exchange({});
    fresh_ = false;
    return now_;
  }
  void hold(const Vector& tau, double /*until_s*/) final {
    now_ = exchange(tau);
    fresh_ = true;
  }
  void rest(double /*until_s*/) final { hold({}, 0); }

 private:
  /// Answers the robot's tick with `tau` [N m; N], waits for its next tick, and returns what the
  /// robot measured then. The state has `time_s` if the robot reports its time. `tau` is empty
  /// before `start`, after `stop`, and where a command is withheld: the driver then answers without
  /// a torque.
  /// @throw base::Failure(protective_stop) when no tick comes
  virtual ArmState exchange(const Vector& tau) = 0;

  ArmState now_;
  bool fresh_ = false;  ///< `read` has not returned `now_` yet
};

}  // namespace tachless::plant
