#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "bus/transport.h"
#include "experiment/scenario.h"
#include "node/link.h"
#include "node/session.h"
#include "plant/guarded_robot.h"
#include "plant/plant_messages.h"
#include "protocol/realtime/realtime.h"

namespace tachless::plant {

/// The plant on the wall clock: tick k begins at the absolute deadline start + k h, whether its
/// command has come or not. No tick is left out: late ones follow as fast as they can, each with
/// half a period for its command. A missed command holds the last torque. Too many in a row, or
/// whatever else ends the run early, is a protective stop first: drives without torque, braking,
/// recorded, for `longest_stop` at most.
class RealtimeLoop {
 public:
  static constexpr std::chrono::milliseconds longest_stop{500};

  /// @param driver a real robot's, which outlives this; the scenario is emulated when null
  RealtimeLoop(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link,
               RobotDriver* driver = nullptr);

  /// Joins, keeps time over all ticks, leaves; then notes in the statistics, as a fault with exit
  /// code 1, when more deadlines were missed than the scenario allows.
  void run();

 private:
  [[nodiscard]] loop::Clock::time_point deadline(std::int64_t tick) const;
  [[nodiscard]] loop::Clock::time_point end_of_tick() const;
  void refuse_early(const bus::Datagram& datagram);
  void introduce();
  void start();
  void keep_time();
  void judge_deadlines();
  void begin_tick();
  void note_wake_up(loop::Clock::time_point now);
  void require_recent_torque(loop::Clock::time_point now) const;
  void publish_question(loop::Clock::time_point now);
  void act(loop::truth::DriveFault fault);
  void receive_until(loop::Clock::time_point deadline);
  void on_command(const bus::Datagram& datagram);
  void end_tick();
  [[nodiscard]] diagnostics::Failure protective_stop(const std::string& why) const;
  [[nodiscard]] std::string what_is_missing() const;
  [[nodiscard]] std::string what_to_mend() const;
  void come_to_rest(const diagnostics::Failure& failure);

  const experiment::Scenario& scenario_;
  bus::Transport& transport_;
  node::Link& link_;
  node::Loop loop_;
  GuardedRobot robot_;
  PlantMessages messages_;
  protocol::realtime::MissedCommandMonitor commands_;

  loop::Clock::time_point start_;
  loop::Clock::time_point tick_began_;    ///< tick_ did, on time or late
  loop::Clock::time_point asked_;         ///< when the measurement of tick_ was published
  loop::Clock::time_point commanded_at_;  ///< when the drives last got a torque that had come
  std::int64_t tick_ = -1;
  bool begun_ = false;  ///< the question of tick_ has been published
  bool acted_ = false;  ///< the torque over tick_ is decided, and its TRUTH published
  bool held_ = false;   ///< the command of the last tick is missing
  std::int64_t late_in_a_row_ = 0;
  std::chrono::nanoseconds longest_delay_{};  ///< of own wake-ups since the last command
};

}  // namespace tachless::plant
