#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "app/scenario.h"
#include "app/session.h"
#include "bus/lockstep/message_ring.h"
#include "bus/lockstep/requester.h"
#include "bus/transport.h"
#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "plant/arm.h"
#include "plant/drive.h"
#include "plant/encoder.h"
#include "plant/measurement_source.h"
#include "robot/model.h"

namespace plant {

/// The plant in simulation time: it advances only with the command for this tick.
class LockstepLoop {
 public:
  LockstepLoop(const app::Scenario& scenario, bus::Transport& transport, app::Session& session);

  /// Meets the others, runs all ticks, parts.
  void run();

 private:
  [[nodiscard]] bus::Stamp stamp(std::int64_t tick) const;
  void introduce();
  void begin_tick();
  void receive(bus::Clock::time_point deadline);
  void on_command(const bus::Datagram& datagram);
  void on_ack(const bus::Datagram& datagram);
  void end_tick();
  void advance(std::int64_t tick);
  void repeat(bus::Clock::time_point now);
  void give_up_if_lost(bus::Clock::time_point now) const;
  template <class Value>
  bool accept(const bus::Codec<Value>& codec, const bus::Datagram& datagram, bus::Stamp& stamp,
              Value& value);

  const app::Scenario& scenario_;
  bus::Transport& transport_;
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

  bus::lockstep::Requester requester_;
  // Known when the controller has said what it measures.
  std::unique_ptr<MeasurementSource> measurement_;
  std::optional<bus::lockstep::MessageRing> sent_;
  std::string measurement_channel_;
  std::vector<std::byte> run_info_;

  robot::TorqueCommand command_;
  bus::truth::PlantTruth truth_;
};

}  // namespace plant
