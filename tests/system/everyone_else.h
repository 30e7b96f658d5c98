#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bus/truth/truth_wire.h"
#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "protocol/membership.h"

namespace tachless::system_test {

/// Stands in for plant, reference and controller of a realtime run with two rigid joints, so that a
/// logger can be given what it would hear, at any pace.
class EveryoneElse {
 public:
  static constexpr std::int64_t run_id = 7;
  static constexpr int messages_per_tick = 6;

  EveryoneElse(const experiment::Scenario& scenario, const std::string& url);

  /// Until the logger has acknowledged RUN_INFO.
  void meet_the_logger();
  /// The plant announces that it runs, or (then) that it has finished.
  void announce(loop::ParticipantState state);
  /// All messages of tick k at once.
  void say(std::int64_t k);

  [[nodiscard]] std::uint64_t unsent() const { return transport_.statistics().unsent; }

 private:
  void publish(protocol::Membership& member);
  bool handle_until(loop::Clock::time_point deadline);

  const experiment::Scenario& scenario_;
  bus::UdpTransport transport_;
  std::string prefix_;
  std::vector<protocol::Membership> members_;  ///< plant, reference, controller
  bus::Codec<loop::Participant> participants_;
  bus::Codec<loop::RunInfo> run_infos_;
  bus::Codec<loop::Tick> ticks_;
  bus::Codec<loop::PositionMeasurement> positions_;
  bus::Codec<loop::ReferencePoint> references_;
  bus::Codec<loop::TorqueCommand> commands_;
  bus::Codec<loop::LawSignals> states_;
  bus::Codec<loop::truth::PlantTruth> truths_;
};

}  // namespace tachless::system_test
