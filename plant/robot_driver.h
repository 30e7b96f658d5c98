#pragma once

#include <string>
#include <vector>

#include "base/failure.h"
#include "base/quantities.h"
#include "plant/arm_state.h"

namespace tachless::plant {

/// Thrown by a driver's `stop` where nobody can confirm the stop, for example with a lost link, and
/// the robot stops by itself. The text names what makes it stop. `stop` is not called again.
class StopsByItself : public base::Failure {
 public:
  /// @param what makes the robot stop, one line
  explicit StopsByItself(std::string_view what) : Failure(base::ExitCode::protective_stop, what) {}
};

/// A number that a driver counted or measured in a run, for summary.json and the closing table.
struct DriverFigure {
  std::string name;  ///< with its unit: "temperature_joint_3_C"
  double value = 0;  ///< the number, in the unit of the name
};

/// A robot as the loop needs it: the emulator, or the driver of a real one (docs/real_robot.md).
/// Called from one thread, in this order: `start` once; then, tick by tick, `read` and `hold`;
/// `stop` once, at the end of every run, good or bad, that came as far as `start`; then `rest`
/// about once a tick until the process ends, and `figures` once.
///
/// A driver reports a fault by throwing base::Failure(protective_stop), whose text the user
/// reads; anything it throws stops the robot. No call but `start` may take long: it is the loop's
/// time, and `read` and `hold` allocate nothing.
class RobotDriver {
 public:
  virtual ~RobotDriver() = default;

  /// Returns true if `read` measures velocities. If not, laws that need them are refused, and the
  /// velocities that `read` gives are for the log alone.
  [[nodiscard]] virtual bool measures_velocity() const = 0;

  /// Returns true if the robot is the clock: its tick is over, and the next one begins, when
  /// `hold` returns.
  [[nodiscard]] virtual bool is_clock() const { return false; }

  /// Enables the drives: all processes have joined, and the first tick is milliseconds ahead.
  virtual void start() = 0;

  /// Positions now, the beginning of a tick, and velocities (measured, or as well as the driver
  /// knows them). May be called before `start`. A robot that does not answer in time gives a state
  /// that is `missing`: the last torque is held over the tick, and no law steps. More than
  /// loop.max_missed in a row are a protective stop. A driver that knows the cause throws before.
  virtual ArmState read() = 0;

  /// Motor torque [N m; N if prismatic] from now on, within the limits; without what the arm adds
  /// itself and in the driver's signs (robot.compensates, robot.joint_signs). `until_s` since the
  /// start of the run is where the tick ends: an emulator moves on to there, a real robot does by
  /// itself.
  virtual void hold(const Vector& tau, double until_s) = 0;

  /// The protective stop, and the end of the run: no torque any more, brakes closed. Returns at
  /// once, while the robot still comes to rest. Called again if it throws, unless it throws
  /// `StopsByItself`.
  virtual void stop() = 0;

  /// Replaces `hold` in a tick of a robot that is stopped, or to which `commission` sends nothing.
  /// After the run it is called about once a tick until the process ends: a driver whose robot
  /// holds itself by commands keeps it there. An emulator's time goes on to `until_s`.
  virtual void rest(double until_s) { static_cast<void>(until_s); }

  /// Returns what the driver counted and measured in this run. Called after `stop`.
  [[nodiscard]] virtual std::vector<DriverFigure> figures() const { return {}; }
};

/// A robot whose own controller is the clock (KUKA's FRI, libfranka): once in each of its ticks it
/// tells what it measured and takes a torque. Ticks begin when it says so. With `time_s` the loop
/// counts them by the robot's own time. A tick with a lost state is a missed tick.
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
  /// Answers the robot's tick with `tau` [N m; N] (empty, before `start`, after `stop` and where a
  /// command is withheld: with nothing), waits for its next tick, and returns what the robot
  /// measured then, with `time_s` if it tells its time. @throw
  /// base::Failure(protective_stop) when no tick comes
  virtual ArmState exchange(const Vector& tau) = 0;

  ArmState now_;
  bool fresh_ = false;  ///< `now_` is of a tick that has not been read
};

}  // namespace tachless::plant
