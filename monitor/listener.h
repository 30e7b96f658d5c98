#pragma once

#include <atomic>
#include <cstdint>

#include "bus/transport.h"
#include "loop/clock.h"
#include "monitor/bus_monitor.h"

namespace tachless::monitor {

/// Reads everything that is on the bus. It does not wait on the socket: whoever sends to a socket
/// that a process waits on pays for waking it. Instead it sleeps for as long as the socket's buffer
/// surely holds what comes, and then takes it all. Prints nothing.
class Listener {
 public:
  Listener(bus::MonitoredBus& transport, BusMonitor& monitor, const std::atomic<bool>& interrupted)
      : transport_(transport), monitor_(monitor), interrupted_(interrupted) {}

  /// Gives to the monitor what comes until `end` or an interruption, and what the transport lost.
  /// Ends the monitor's stretch of time, which began at `begin`.
  void listen(loop::Clock::time_point begin, loop::Clock::time_point end);

 private:
  std::uint64_t drain(loop::Clock::time_point end);
  void drain_what_came_before_now();
  void adapt(std::uint64_t count, loop::Clock::time_point begin);

  static constexpr std::chrono::milliseconds shortest_nap{1}, longest_nap{50};

  bus::MonitoredBus& transport_;
  BusMonitor& monitor_;
  const std::atomic<bool>& interrupted_;
  loop::Clock::duration nap_ = shortest_nap;
  loop::Clock::time_point last_drain_ = loop::Clock::now();
  std::uint64_t bytes_ = 0;
};

}  // namespace tachless::monitor
