#pragma once

#include <cstdint>
#include <optional>

#include "app/scenario.h"
#include "app/session.h"
#include "bus/lockstep/message_ring.h"
#include "bus/lockstep/requester.h"
#include "bus/transport.h"
#include "plant/robot_on_bus.h"

namespace plant {

/// The plant in simulation time: it advances only with the command for this tick.
class LockstepLoop {
 public:
  LockstepLoop(const app::Scenario& scenario, bus::Transport& transport, app::Session& session);

  /// Meets the others, runs all ticks, parts.
  void run();

 private:
  void introduce();
  void help_successor(bus::Clock::time_point now);
  void begin_tick();
  void receive(bus::Clock::time_point deadline);
  void on_command(const bus::Datagram& datagram);
  void on_ack(const bus::Datagram& datagram);
  void end_tick();
  void repeat(bus::Clock::time_point now);
  void give_up_if_lost(bus::Clock::time_point now) const;

  const app::Scenario& scenario_;
  bus::Transport& transport_;
  app::Session& session_;
  RobotOnBus robot_;
  bus::lockstep::Requester requester_;
  std::optional<bus::lockstep::MessageRing> sent_;  // sized when the measurement is known
};

}  // namespace plant
