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
#include "node/link.h"
#include "plant/encoder.h"
#include "plant/guarded_robot.h"
#include "plant/measurement_source.h"

namespace tachless::plant {

/// The messages that a plant publishes and takes: channels, content, bytes. Sends nothing itself
/// and does not know when a tick is.
class PlantMessages {
 public:
  /// @param robot whose state and torques they tell; outlives this
  PlantMessages(const experiment::Scenario& scenario, const GuardedRobot& robot, node::Link& link);

  /// Once the others have joined: chooses the measurement, writes RUN_INFO.
  /// @throw diagnostics::Failure(bad_usage) when the robot does not measure what the law needs or
  /// RUN_INFO is too long, (protocol_violated) when there is no such measurement.
  void prepare();

  /// A message's channel and longest size [bytes].
  struct Port {
    std::string channel;
    std::size_t longest = 0;
  };
  [[nodiscard]] const Port& tick_port() const { return tick_port_; }
  [[nodiscard]] const Port& command_port() const { return command_port_; }
  [[nodiscard]] const Port& truth_port() const { return truth_port_; }
  [[nodiscard]] const Port& run_info_port() const { return run_info_port_; }
  [[nodiscard]] const Port& ack_port() const { return ack_port_; }
  [[nodiscard]] const Port& measurement_port() const { return measurement_port_; }  ///< prepared

  /// The moment t_k = k h of this run, not accumulated.
  [[nodiscard]] loop::Stamp stamp(std::int64_t tick) const;

  // Each valid until its next call.
  [[nodiscard]] std::span<const std::byte> run_info() const { return run_info_; }
  std::span<const std::byte> tick(const loop::Stamp& stamp);
  /// What the encoders read of the robot's state.
  /// @throw diagnostics::Failure(protective_stop) when it is not finite.
  std::span<const std::byte> measurement(std::int64_t tick);
  /// The robot's state at the beginning of the tick and the torque over it. Counts saturation, so
  /// once a tick.
  /// @throw diagnostics::Failure(protective_stop) when the state is not finite.
  std::span<const std::byte> truth(std::int64_t tick, loop::truth::DriveFault fault);

  /// Whether the message is a command of this run; counts it if not. It is `command()` then.
  /// @throw diagnostics::Failure(protective_stop) when this run's controller commands a torque that
  /// is not finite. (Anybody else's is dropped.)
  bool accept_command(const bus::Datagram& datagram, loop::Stamp& stamp);
  [[nodiscard]] const loop::TorqueCommand& command() const { return command_; }
  /// Whether it is an acknowledgement of this run, from the address of the logger that has joined;
  /// counts it if not.
  bool accept_ack(const bus::Datagram& datagram, loop::Stamp& stamp, loop::LogAck& ack);
  /// Whether bytes on the command channel have the shape of a command of whatever run.
  [[nodiscard]] bool is_command(std::span<const std::byte> payload) const;

 private:
  const experiment::Scenario& scenario_;
  const GuardedRobot& robot_;
  node::Link& link_;
  Encoder encoder_;
  loop::Layout layout_;
  bus::Codec<loop::Tick> tick_codec_;
  bus::Codec<loop::TorqueCommand> command_codec_;
  bus::Codec<loop::truth::PlantTruth> truth_codec_;
  bus::Codec<loop::LogAck> ack_codec_;
  Port tick_port_, command_port_, truth_port_, run_info_port_, ack_port_, measurement_port_;
  std::unique_ptr<MeasurementSource> measurement_;
  std::vector<std::byte> run_info_;
  loop::TorqueCommand command_;
  loop::truth::PlantTruth truth_;
};

}  // namespace tachless::plant
