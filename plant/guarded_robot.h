#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/clock.h"
#include "base/failure.h"
#include "messages/measurements.h"
#include "plant/arm_state.h"
#include "plant/drive.h"
#include "plant/encoder.h"
#include "plant/robot_driver.h"
#include "reference/make_trajectory.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::plant {

bool all_finite(const ArmState& state);
/// What to throw when the state at `tick` is not.
base::Failure not_finite(std::int64_t tick);

/// A robot (the emulator, or a real one's driver) behind the checks of its readings and torques:
/// readings finite, joints within their ranges and (the emulator's) speeds, the start where the
/// scenario begins, torques finite and within the drives' limits; and its encoders. Knows neither
/// the bus nor the clock.
class GuardedRobot {
 public:
  /// @param driver a real robot's, which outlives this; the scenario is emulated when null. With a
  /// driver the emulator's keys (plant.integrator, plant.payload, friction) are not used.
  /// @throw base::Failure(bad_usage) when a joint of a real robot has no torque limit.
  explicit GuardedRobot(const scenario::Scenario& scenario, RobotDriver* driver = nullptr);
  GuardedRobot(const GuardedRobot&) = delete;
  GuardedRobot& operator=(const GuardedRobot&) = delete;
  /// Stops a robot that was started and not stopped.
  ~GuardedRobot() { stop(); }

  /// An emulated robot's time is its ticks: it stands still when this process does.
  [[nodiscard]] bool emulated() const { return emulator_ != nullptr; }

  [[nodiscard]] bool is_clock() const { return driver_.is_clock(); }

  /// The law is fed with the measurement of that channel suffix.
  /// @throw base::Failure(bad_usage) when the robot does not measure it,
  /// (protocol_violated) when there is no such measurement.
  void feed(std::string_view measurement);

  /// The run begins now. A real robot has to be where the scenario begins, to `start_tolerance`;
  /// with plant.dry_run it may be anywhere, is not started, and counts as stopped.
  /// @throw base::Failure(bad_usage) when it is elsewhere, or its own ticks are not as long
  /// as the scenario's.
  void start();
  static constexpr double start_tolerance = 0.01;  ///< [rad; m]

  /// The state at the beginning of `tick`.
  /// @throw base::Failure(protective_stop) when a real robot's is not finite, or, unless the
  /// robot is stopped already, a joint is outside of its range, too fast (by its velocity or, where
  /// that is not measured, on the average of 20 ms; with plant.on_limit: warn an emulated one is
  /// warned of instead, once per joint) or further
  /// from its reference than plant.following_error_rad, or when a driver reads another number of
  /// joints than the scenario has.
  const ArmState& read(std::int64_t tick);
  [[nodiscard]] const ArmState& state() const { return state_; }  ///< as last read
  /// The encoders' readings of the measurement that `feed` chose; of an emulated robot's state some
  /// ticks ago (plant.encoder.latency_ticks). Valid until the next call.
  /// @throw base::Failure(protective_stop) when it is not finite.
  const messages::AnyMeasurement& measure(std::int64_t tick);
  /// The joints that were outside of range or too fast when last read, where that is no stop.
  [[nodiscard]] const std::array<bool, max_joints>& beyond_limit() const { return beyond_limit_; }

  /// The drives take the command as this tick's. @throw std::logic_error as `Drive::accept`
  void accept(const messages::TorqueCommand& command) { drive_.accept(command); }
  /// The torque over this tick.
  [[nodiscard]] const AppliedTorque& applied() const { return drive_.applied(); }
  /// Gives the robot that torque for `tick`; once stopped, none. @return the time this has taken
  /// @throw base::Failure(protective_stop) when the simulation diverges.
  std::chrono::nanoseconds advance(std::int64_t tick);
  /// The tick is over for the drives.
  void end_tick() { drive_.end_tick(); }

  /// The protective stop and the end: no torque any more, the robot brakes. A driver whose stop
  /// throws is asked again, `stop_attempts` times now and once in each `advance`.
  void stop() noexcept;
  static constexpr int stop_attempts = 10;
  /// Writes a warning when the driver's stop has thrown before it succeeded.
  /// @param cause why the robot was to stop, if it was not the end of the run
  /// @throw base::Failure when it has not succeeded, with the words of `cause` and its exit
  /// code, or else protective_stop.
  void require_stopped(const base::Failure* cause = nullptr) const;
  /// Whether all joints and motors stood still when last read, to 1 mrad/s (mm/s).
  [[nodiscard]] bool at_rest() const;

 private:
  void require_start() const;
  void require_period();
  /// `state_`, as the driver read it, in the scenario's coordinates.
  void apply_conventions();
  void try_to_stop() noexcept;
  /// Calls the driver's `hold` or `rest` for this tick.
  void hold_or_rest(std::int64_t tick);
  /// The same for the emulator, whose errors have other words.
  void move_emulator(std::int64_t tick);
  void require_sound(std::int64_t tick) const;
  /// @throw base::Failure(protective_stop) when the time went back, stood still while the robot
  /// moved, or is given in some readings alone
  void require_time(const ArmState& before, std::int64_t tick) const;
  /// Sets `speed_` of a robot that does not measure it: the mean over at least `speed_window_s`, by
  /// the robot's clock if it has one, else by this computer's. The mean never overestimates.
  /// @param asked the time before `state_` was read
  void measure_speed(base::Clock::time_point asked);
  void watch_limits(std::int64_t tick);
  void watch_following(std::int64_t tick);
  [[nodiscard]] std::string limit_text(Eigen::Index joint, bool outside, std::int64_t tick) const;

  const scenario::Scenario& scenario_;
  robot::Model model_;
  std::unique_ptr<RobotDriver> emulator_;  ///< null with a real robot
  RobotDriver& driver_;
  Drive drive_;
  Encoder encoder_;
  messages::AnyMeasurement measurement_;
  Vector following_error_;  ///< limit; empty: none
  std::optional<reference::Trajectory> trajectory_;
  Vector first_error_;  ///< |q - q_ref| at tick 0
  ArmState state_;
  Vector speed_;  ///< of each joint [rad/s; m/s]
  static constexpr double speed_window_s = 0.02;
  struct {
    Vector q;
    base::Clock::time_point asked;
    double time_s = 0;
  } mark_;                      ///< where the window of `speed_` begins
  std::vector<ArmState> past_;  ///< of the last ticks, a ring
  std::size_t sensed_ = 0;
  std::array<bool, max_joints> beyond_limit_{}, warned_{};
  bool started_ = false;
  bool stopped_ = false;
  bool driver_stopped_ = false;  ///< its stop has returned
  int failed_stops_ = 0;
  std::string stop_problem_;  ///< of the last one that failed
};

}  // namespace tachless::plant
