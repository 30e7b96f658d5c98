#pragma once

#include <cstdint>
#include <optional>

#include "bus/transport.h"
#include "experiment/scenario.h"
#include "node/session.h"
#include "plant/robot_on_bus.h"
#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/tick_master.h"

namespace tachless::plant {

/// The plant in simulation time: it advances only with the command for this tick.
class LockstepLoop {
 public:
  LockstepLoop(const experiment::Scenario& scenario, bus::Transport& transport,
               node::Session& session);

  /// Meets the others, runs all ticks, parts.
  void run();

 private:
  void introduce();
  void help_successor(loop::Clock::time_point now);
  void begin_tick();
  void receive(loop::Clock::time_point deadline);
  void on_command(const bus::Datagram& datagram);
  void on_ack(const bus::Datagram& datagram);
  void end_tick();
  void repeat(loop::Clock::time_point now);
  void give_up_if_lost(loop::Clock::time_point now) const;

  const experiment::Scenario& scenario_;
  bus::Transport& transport_;
  node::Session& session_;
  RobotOnBus robot_;
  protocol::lockstep::TickMaster tick_master_;
  std::optional<protocol::lockstep::MessageRing> sent_;  // sized when the measurement is known
};

}  // namespace tachless::plant
