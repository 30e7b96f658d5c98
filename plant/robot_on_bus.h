#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "app/scenario.h"
#include "app/session.h"
#include "bus/transport.h"
#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "plant/arm.h"
#include "plant/drive.h"
#include "plant/encoder.h"
#include "plant/measurement_source.h"
#include "robot/model.h"

namespace plant {

/// The emulated robot as the bus sees it: arm, encoders and drives, and the messages they give and
/// take, tick by tick. Knows neither when a tick is, nor what to do about one that is missing.
class RobotOnBus {
 public:
  RobotOnBus(const app::Scenario& scenario, app::Session& session);

  [[nodiscard]] const std::string& tick_channel() const { return tick_channel_; }
  [[nodiscard]] const std::string& command_channel() const { return command_channel_; }
  [[nodiscard]] const std::string& truth_channel() const { return truth_channel_; }
  [[nodiscard]] const std::string& run_info_channel() const { return run_info_channel_; }
  [[nodiscard]] const std::string& ack_channel() const { return ack_channel_; }
  /// Known when the controller has said what it measures, i.e. after `prepare`.
  [[nodiscard]] const std::string& measurement_channel() const { return measurement_channel_; }

  /// Longest messages of a tick [bytes].
  [[nodiscard]] std::size_t longest_tick() const { return tick_codec_.longest(); }
  [[nodiscard]] std::size_t longest_measurement() const { return measurement_->longest(); }
  [[nodiscard]] std::size_t longest_truth() const { return truth_codec_.longest(); }
  [[nodiscard]] std::size_t longest_command() const { return command_codec_.longest(); }

  /// Once the session has met the others: chooses the measurement, writes RUN_INFO.
  /// @throw app::Failure(bad_usage, protocol_violated)
  void prepare();
  [[nodiscard]] std::span<const std::byte> run_info() const { return run_info_; }

  /// The moment t_k = k h of this run, not accumulated.
  [[nodiscard]] bus::Stamp stamp(std::int64_t tick) const;

  // Each valid until its next call.
  /// @throw app::Failure(protective_stop) when the state is not finite.
  std::span<const std::byte> measurement(std::int64_t tick);
  std::span<const std::byte> tick(const bus::Stamp& stamp);
  /// The present state and the torque that acts on it. Counts saturation, so once a tick.
  /// @throw app::Failure(protective_stop) when the state is not finite.
  std::span<const std::byte> truth(std::int64_t tick, bus::truth::DriveFault fault);

  /// Whether the message is a command of this run; counts it if not. What it says is then known to
  /// `drive`. @throw app::Failure(protective_stop) when this run's controller commands a torque
  /// that is not finite. (A stranger's is dropped.)
  bool hear_command(const bus::Datagram& datagram, bus::Stamp& stamp);
  /// Whether it is an acknowledgement of this run.
  bool hear_ack(const bus::Datagram& datagram, bus::Stamp& stamp, bus::LogAck& ack);
  /// Whether bytes on the command channel have the shape of a command of whatever run.
  [[nodiscard]] bool is_command(std::span<const std::byte> payload) const;

  /// The drives take the command heard last as this tick's.
  void drive();
  /// Integrates over tick `tick` under the torque that the drives apply.
  /// @throw app::Failure(protective_stop) when the simulation diverges.
  void advance(std::int64_t tick);
  /// The tick is over for the drives.
  void end_tick() { drive_.end_tick(); }

  /// The protective stop: no torque any more, viscous braking (`protective_stop_damping`).
  void brake();
  /// Whether all joints and motors stand still, to 1 mrad/s (mm/s).
  [[nodiscard]] bool at_rest() const;

  /// What to throw when two processes command `tick`.
  [[nodiscard]] app::Failure two_commanders(std::int64_t tick, std::string_view first,
                                            std::string_view second) const;

 private:
  const app::Scenario& scenario_;
  app::Session& session_;

  robot::Model model_;
  Arm arm_;
  Encoder encoder_;
  Drive drive_;

  bus::Layout layout_;
  std::string tick_channel_, command_channel_, truth_channel_, run_info_channel_, ack_channel_;
  bus::Codec<bus::Tick> tick_codec_;
  bus::Codec<robot::TorqueCommand> command_codec_;
  bus::Codec<bus::truth::PlantTruth> truth_codec_;
  bus::Codec<bus::LogAck> ack_codec_;
  std::unique_ptr<MeasurementSource> measurement_;
  std::string measurement_channel_;
  std::vector<std::byte> run_info_;

  robot::TorqueCommand command_;
  bus::truth::PlantTruth truth_;
};

}  // namespace plant
