#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "bus/transport.h"
#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "node/session.h"
#include "plant/drive.h"
#include "plant/encoder.h"
#include "plant/measurement_source.h"
#include "plant/robot_driver.h"
#include "robot/model.h"

namespace tachless::plant {

/// A robot as the bus sees it: encoders and drives, and the messages they give and take, tick by
/// tick. Knows neither when a tick is, nor what to do about one that is missing.
class RobotOnBus {
 public:
  /// @param driver a real robot's, which outlives this; the scenario is emulated when null. What
  /// the scenario says of the emulator (plant.integrator, plant.payload, noise and resolution of
  /// plant.encoder, friction) is not used then.
  /// @throw diagnostics::Failure(bad_usage) when a joint of a real robot has no torque limit.
  RobotOnBus(const experiment::Scenario& scenario, node::Session& session,
             RobotDriver* driver = nullptr);

  [[nodiscard]] const std::string& tick_channel() const { return tick_channel_; }
  [[nodiscard]] const std::string& command_channel() const { return command_channel_; }
  [[nodiscard]] const std::string& truth_channel() const { return truth_channel_; }
  [[nodiscard]] const std::string& run_info_channel() const { return run_info_channel_; }
  [[nodiscard]] const std::string& ack_channel() const { return ack_channel_; }
  /// Known when the controller has said what it measures, i.e. after `prepare`.
  [[nodiscard]] const std::string& measurement_channel() const { return measurement_channel_; }

  /// An emulated robot's time is its ticks: it stands still when this process does.
  [[nodiscard]] bool emulated() const { return emulator_ != nullptr; }

  /// Longest messages of a tick [bytes].
  [[nodiscard]] std::size_t longest_tick() const { return tick_codec_.longest(); }
  [[nodiscard]] std::size_t longest_measurement() const { return measurement_->longest(); }
  [[nodiscard]] std::size_t longest_truth() const { return truth_codec_.longest(); }
  [[nodiscard]] std::size_t longest_command() const { return command_codec_.longest(); }

  /// Once the session has met the others: chooses the measurement, writes RUN_INFO.
  /// @throw diagnostics::Failure(bad_usage, protocol_violated)
  void prepare();
  [[nodiscard]] std::span<const std::byte> run_info() const { return run_info_; }

  /// The moment t_k = k h of this run, not accumulated.
  [[nodiscard]] loop::Stamp stamp(std::int64_t tick) const;

  /// The run begins now. A real robot has to be where the scenario begins, to `start_tolerance`.
  /// @throw diagnostics::Failure(bad_usage) when it is elsewhere.
  void start();
  static constexpr double start_tolerance = 0.01;  ///< [rad; m]

  // Each valid until its next call.
  /// Reads the robot at the beginning of a tick.
  /// @throw diagnostics::Failure(protective_stop) when the state is not finite, or a real robot's
  /// joint is outside of its range.
  std::span<const std::byte> measurement(std::int64_t tick);
  std::span<const std::byte> tick(const loop::Stamp& stamp);
  /// The state at the beginning of the tick and the torque over it. Counts saturation, so once a
  /// tick.
  /// @throw diagnostics::Failure(protective_stop) when the state is not finite.
  std::span<const std::byte> truth(std::int64_t tick, loop::truth::DriveFault fault);

  /// Whether the message is a command of this run; counts it if not. What it says is then known to
  /// `drive`. @throw diagnostics::Failure(protective_stop) when this run's controller commands a
  /// torque that is not finite. (A stranger's is dropped.)
  bool hear_command(const bus::Datagram& datagram, loop::Stamp& stamp);
  /// Whether it is an acknowledgement of this run.
  bool hear_ack(const bus::Datagram& datagram, loop::Stamp& stamp, loop::LogAck& ack);
  /// Whether bytes on the command channel have the shape of a command of whatever run.
  [[nodiscard]] bool is_command(std::span<const std::byte> payload) const;

  /// The drives take the command heard last as this tick's.
  void drive();
  /// Gives the robot the torque of the drives for tick `tick`; once stopped, none.
  /// @throw diagnostics::Failure(protective_stop) when the simulation diverges.
  void advance(std::int64_t tick);
  /// The tick is over for the drives.
  void end_tick() { drive_.end_tick(); }

  /// The protective stop and the end: no torque any more, the robot brakes. Once is enough.
  void stop();
  /// Whether all joints and motors stood still when last measured, to 1 mrad/s (mm/s).
  [[nodiscard]] bool at_rest() const;

  /// What to throw when two processes command `tick`.
  [[nodiscard]] diagnostics::Failure two_commanders(std::int64_t tick, std::string_view first,
                                                    std::string_view second) const;

 private:
  void read(std::int64_t tick);

  const experiment::Scenario& scenario_;
  node::Session& session_;

  robot::Model model_;
  std::unique_ptr<RobotDriver> emulator_;  ///< null with a real robot
  RobotDriver& driver_;
  Encoder encoder_;
  Drive drive_;
  ArmState state_;  ///< at the beginning of the tick
  bool started_ = false;
  bool stopped_ = false;

  loop::Layout layout_;
  std::string tick_channel_, command_channel_, truth_channel_, run_info_channel_, ack_channel_;
  bus::Codec<loop::Tick> tick_codec_;
  bus::Codec<loop::TorqueCommand> command_codec_;
  bus::Codec<loop::truth::PlantTruth> truth_codec_;
  bus::Codec<loop::LogAck> ack_codec_;
  std::unique_ptr<MeasurementSource> measurement_;
  std::string measurement_channel_;
  std::vector<std::byte> run_info_;

  loop::TorqueCommand command_;
  loop::truth::PlantTruth truth_;
};

}  // namespace tachless::plant
