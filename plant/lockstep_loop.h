#pragma once

#include <optional>

#include "bus/key.h"
#include "bus/transport.h"
#include "experiment/scenario.h"
#include "node/link.h"
#include "node/session.h"
#include "plant/guarded_robot.h"
#include "plant/plant_messages.h"
#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/tick_master.h"

namespace tachless::plant {

/// The plant in simulation time: it advances only with the command for this tick.
class LockstepLoop {
 public:
  LockstepLoop(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link);

  /// Joins, runs all ticks, leaves.
  void run();

 private:
  using Time = loop::Clock::time_point;

  void introduce();
  void help_successor(Time now);
  void begin_tick();
  void on_command(const bus::Datagram& datagram);
  void on_ack(const bus::Datagram& datagram);
  void end_tick();
  void repeat(Time now);
  void give_up_if_lost(Time now) const;

  const experiment::Scenario& scenario_;
  bus::Transport& transport_;
  node::Link& link_;
  node::Loop loop_;
  GuardedRobot robot_;
  PlantMessages messages_;
  protocol::lockstep::TickMaster tick_master_;
  bus::Digest truth_digest_;
  std::optional<protocol::lockstep::MessageRing> sent_;  // sized when the measurement is known
};

}  // namespace tachless::plant
