#pragma once

#include <termios.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <optional>

#include "bus/udp_transport.h"
#include "loop/clock.h"
#include "monitor/bus_monitor.h"

/// Between a bus, its monitor and a terminal.
namespace tachless::monitor {

/// Reads everything that is on the bus. It does not wait on the socket: a sender to a socket
/// that a process waits on pays for the wake-up. Instead it sleeps for as long as the socket's
/// buffer certainly holds the traffic, and then takes it all. Prints nothing.
class Listener {
 public:
  Listener(bus::UdpTransport& transport, BusMonitor& monitor, const std::atomic<bool>& interrupted)
      : transport_(transport), monitor_(monitor), interrupted_(interrupted) {}

  /// Gives to the monitor what comes until `end` or an interruption, and what the transport lost.
  /// Ends the monitor's interval, which began at `begin`.
  void listen(loop::Clock::time_point begin, loop::Clock::time_point end);

 private:
  double drain(loop::Clock::time_point end);
  void drain_what_came_before_now();

  static constexpr std::chrono::milliseconds shortest_nap{1}, longest_nap{50};

  bus::UdpTransport& transport_;
  BusMonitor& monitor_;
  const std::atomic<bool>& interrupted_;
  loop::Clock::duration nap_ = shortest_nap;
  loop::Clock::time_point last_drain_ = loop::Clock::now();
};

/// Shows a monitor's table on stdout again and again: on a terminal in place and cut to its size,
/// elsewhere one after the other. Keys are read on a terminal.
class TableScreen {
 public:
  TableScreen();  ///< hides the cursor until destruction
  TableScreen(const TableScreen&) = delete;
  TableScreen& operator=(const TableScreen&) = delete;
  ~TableScreen();

  void show(BusMonitor& monitor);

  /// Whether the user has typed q since the last call.
  [[nodiscard]] bool quit_wanted();

 private:
  bool terminal_;
  std::size_t height_ = 0;
  std::optional<termios> keyboard_;  ///< its settings before: keys come one by one, unseen
};

}  // namespace tachless::monitor
