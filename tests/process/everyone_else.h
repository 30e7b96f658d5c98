#pragma once

#include <cstdint>
#include <string>

#include "app/scenario.h"
#include "bus/truth/truth_wire.h"
#include "bus/udp_transport.h"
#include "bus/wire.h"

namespace process_test {

/// Stands in for plant, reference and controller of a realtime run with two rigid joints, so that a
/// logger can be given what it would hear, at any pace.
class EveryoneElse {
 public:
  static constexpr std::int64_t run_id = 7;
  static constexpr int messages_per_tick = 6;

  EveryoneElse(const app::Scenario& scenario, const std::string& url);

  /// Until the logger has acknowledged RUN_INFO.
  void meet_the_logger();
  /// The plant's heartbeat.
  void announce(bus::ParticipantState state);
  /// All messages of tick k at once.
  void say(std::int64_t k);

  [[nodiscard]] std::uint64_t unsent() const { return transport_.statistics().unsent; }

 private:
  const app::Scenario& scenario_;
  bus::UdpTransport transport_;
  std::string prefix_;
  bus::Codec<bus::Participant> participants_;
  bus::Codec<bus::RunInfo> run_infos_;
  bus::Codec<bus::Tick> ticks_;
  bus::Codec<robot::PositionMeasurement> positions_;
  bus::Codec<robot::ReferencePoint> references_;
  bus::Codec<robot::TorqueCommand> commands_;
  bus::Codec<robot::ControllerState> states_;
  bus::Codec<bus::truth::PlantTruth> truths_;
};

}  // namespace process_test
