#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/clock.h"
#include "base/failure.h"
#include "base/tick_ring.h"
#include "messages/measurements.h"
#include "plant/arm_state.h"
#include "plant/drive.h"
#include "plant/drive_loop.h"
#include "plant/encoder.h"
#include "plant/motion_guard.h"
#include "plant/own_torque.h"
#include "plant/robot_driver.h"
#include "plant/simulator.h"
#include "reference/make_trajectory.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::plant {

bool all_finite(const ArmState& state);
/// Returns the failure to throw when the state at `tick` is not finite.
base::Failure not_finite(std::int64_t tick);

/// A robot (the emulator, or a real one's driver) with its encoders and checks. The checks require
/// finite readings and joints within their ranges and speeds. A real robot must start where the
/// scenario begins. The drives limit the torques. The class does not know the bus.
class GuardedRobot {
 public:
  /// Emulates the scenario when `driver` is null. With a driver, the robot does not use the
  /// emulator's keys (plant.integrator, plant.payload, friction).
  /// @param driver a real robot's driver, which outlives this object
  /// @param simulator mechanics in place of the emulator's own, which outlive this object; null
  /// with a driver
  /// @throw base::Failure(bad_usage) when a joint of a real robot has no torque limit, for a key of
  /// mechanics that a simulator has itself, and for plant.drive.loop with a driver that is no
  /// DriveLoopDriver.
  explicit GuardedRobot(const scenario::Scenario& scenario, RobotDriver* driver = nullptr,
                        Simulator* simulator = nullptr);
  GuardedRobot(const GuardedRobot&) = delete;
  GuardedRobot& operator=(const GuardedRobot&) = delete;
  /// Stops a robot that was started and not stopped.
  ~GuardedRobot() { stop(); }

  /// Returns true for the emulator. An emulated robot stands still while this process does.
  [[nodiscard]] bool emulated() const { return emulator_ != nullptr; }

  [[nodiscard]] bool is_clock() const { return driver_.is_clock(); }

  /// Returns true from `start` on, unless in a dry run.
  [[nodiscard]] bool has_started() const { return started_; }

  /// Chooses the measurement with that channel suffix for the law.
  /// @throw base::Failure(bad_usage) when the robot does not measure it,
  /// (protocol_violated) when there is no such measurement.
  void feed(std::string_view measurement);

  /// Starts the robot. A real robot has to be within `start_tolerance` of the scenario's start.
  /// With plant.dry_run the robot may be anywhere, does not start, and counts as stopped.
  /// @throw base::Failure(bad_usage) when the robot is elsewhere, or its own ticks are not as long
  /// as the scenario's.
  void start();
  static constexpr double start_tolerance = 0.01;  ///< [rad; m]

  /// Reads the state at the beginning of `tick`. A robot that is the clock and reports its time may
  /// be at a later tick, which `tick()` then returns. A driver may have no reading; `state()` is
  /// then the last one. Before the start such a reading is repeated, loop.max_missed times. With
  /// plant.on_limit: warn, an emulated joint beyond its range or speed causes one warning and no
  /// failure. A robot that does not measure velocity has its speed averaged over at least 20 ms.
  /// @throw base::Failure(protective_stop) when a real robot's state is not finite, or has another
  /// number of joints than the scenario. A robot that has not stopped also fails when a joint is
  /// outside its range, too fast, or too far from its reference (plant.following_error_rad).
  const ArmState& read(std::int64_t tick);
  [[nodiscard]] const ArmState& state() const { return state_; }  ///< last state read
  /// Returns false if the robot gave no state at the last `read`.
  [[nodiscard]] bool has_reading() const { return !missing_; }
  /// Returns the tick of the last `read`: the given one, or a later one by the robot's own time.
  [[nodiscard]] std::int64_t tick() const { return tick_; }
  /// Returns the encoders' readings of the measurement that `feed` chose. An emulated robot's
  /// readings are plant.encoder.latency_ticks old. The result is valid until the next call.
  /// @throw base::Failure(protective_stop) when a reading is not finite.
  const messages::AnyMeasurement& measure(std::int64_t tick);
  /// Returns the joints that were outside their range or too fast at the last reading.
  [[nodiscard]] const std::array<bool, max_joints>& beyond_limit() const { return beyond_limit_; }

  /// Gives the drives the command of this tick.
  /// @throw std::logic_error as `Drive::accept`
  void accept(const messages::TorqueCommand& command) { drive_.accept(command); }
  /// Returns the torque over this tick.
  [[nodiscard]] const AppliedTorque& applied() const { return drive_.applied(); }
  /// Gives the robot that torque for `tick`, or none once it has stopped.
  /// @return the time that the call took
  /// @throw base::Failure(protective_stop) when the simulation diverges.
  std::chrono::nanoseconds advance(std::int64_t tick);
  /// Ends the tick of the drives.
  void end_tick() { drive_.end_tick(); }
  /// Skips ticks in which the robot got no answer and held the last torque.
  void skip(std::int64_t ticks) { drive_.skip(ticks); }

  /// Stops the robot, which then gets no torque and brakes. The call makes up to `stop_attempts`
  /// attempts while the driver's stop throws. Each later `advance` makes one more.
  void stop() noexcept;
  static constexpr int stop_attempts = 10;
  /// Writes a warning when the driver's stop has thrown before it succeeded.
  /// @param cause the reason for the stop; null at the end of the run
  /// @throw base::Failure when the stop has not succeeded or could not be confirmed. The failure
  /// has the text and exit code of `cause`, or else protective_stop.
  void require_stopped(const base::Failure* cause = nullptr) const;
  /// Returns the driver's own figures; empty for the emulator.
  [[nodiscard]] std::vector<DriverFigure> figures() const;
  /// Returns true if there was a reading, and every joint and motor was slower than 1 mrad/s
  /// (mm/s).
  [[nodiscard]] bool at_rest() const;

 private:
  /// Asks the driver for a state.
  /// @throw base::Failure(bad_usage) when there is none before the start
  ArmState ask_driver(std::int64_t tick);
  /// Returns the tick at which the robot measured `state_`, by its own time since tick 0.
  /// @param tick the tick that follows the last one
  std::int64_t own_tick(std::int64_t tick);
  void require_start() const;
  void require_period();
  /// Converts `state_` from the driver's coordinates to the scenario's.
  void apply_conventions();
  void try_to_stop() noexcept;
  /// Calls the driver's `hold` or `rest` for this tick.
  void hold_or_rest(std::int64_t tick);
  /// Returns the set point of the drives' loop over this tick, in the driver's signs.
  [[nodiscard]] SetPoint set_point(std::int64_t tick) const;
  /// Moves the emulator by this tick. Its failures have other texts than the failures of a driver.
  void move_emulator(std::int64_t tick);
  void require_sound(std::int64_t tick) const;
  /// Checks the robot's own time.
  /// @throw base::Failure(protective_stop) when the time went back, stood still while the robot
  /// moved, or only some readings have it
  void require_time(const ArmState& before, std::int64_t tick) const;
  /// Sets `speed_` of a robot that does not measure it. The time is the robot's if it reports one,
  /// else this computer's.
  /// @param asked the time before `state_` was read
  void measure_speed(base::Clock::time_point asked);
  /// Returns the velocity of a joint that is compared with its limit [rad/s; m/s].
  [[nodiscard]] double watched_speed(Eigen::Index joint) const;
  void watch_limits(std::int64_t tick);
  void watch_following(std::int64_t tick);
  [[nodiscard]] std::string limit_text(Eigen::Index joint, bool outside, std::int64_t tick) const;

  const scenario::Scenario& scenario_;
  robot::Model model_;
  std::unique_ptr<Simulator> mujoco_;      ///< simulator of plant.mujoco; null without this key
  std::unique_ptr<RobotDriver> emulator_;  ///< null with a real robot
  RobotDriver& driver_;
  Drive drive_;
  std::optional<OwnTorque> own_torque_;  ///< torque that a real robot adds itself; empty: none
  Encoder encoder_;
  messages::AnyMeasurement measurement_;
  MotionGuard guard_;
  std::optional<scenario::DriveLoopSpec> drive_loop_;  ///< loop of plant.drive.loop
  DriveLoopDriver* follower_ = nullptr;  ///< `driver_` with plant.drive.loop; else null
  /// The run's motion, if the guard watches the following error or the drives have a loop.
  std::optional<reference::Trajectory> trajectory_;
  ArmState state_;
  Vector speed_;  ///< speed of each joint [rad/s; m/s]
  SpeedMeter meter_;
  base::TickRing<ArmState> past_;  ///< states of the last ticks
  std::int64_t sensed_ = 0;        ///< tick of the state that the encoders read
  std::int64_t tick_ = -1;         ///< tick of the last `read`
  double origin_s_ = 0;            ///< the robot's own time at tick 0
  bool missing_ = false;           ///< the last `read` had no state
  std::array<bool, max_joints> beyond_limit_{}, warned_{};
  bool started_ = false;
  bool stopped_ = false;
  bool driver_stopped_ = false;  ///< the driver's stop has returned
  int failed_stops_ = 0;
  std::string stop_problem_;  ///< message of the last stop that failed
  std::string unconfirmed_;   ///< the robot stops by itself for this reason; else empty
};

}  // namespace tachless::plant
