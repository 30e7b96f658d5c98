#pragma once

#include <termios.h>

#include <atomic>
#include <cstddef>
#include <functional>
#include <optional>

#include "base/clock.h"
#include "bus/udp_transport.h"
#include "live/bus_monitor.h"

/// Connection between a bus, its monitor and a terminal.
namespace tachless::live {

/// Calls `take` with every message that has arrived by now.
void drain(bus::UdpTransport& transport, const std::function<void(const bus::Datagram&)>& take);

/// Calls `take` with each message that comes until `end` or an interruption. It does not wait on
/// the socket, because a wake-up costs the senders time. It sleeps for a millisecond, while the
/// socket's buffer holds the messages, and then takes all of them.
void listen(bus::UdpTransport& transport, const std::function<void(const bus::Datagram&)>& take,
            base::Clock::time_point end, const std::atomic<bool>& interrupted);

/// Passes the messages that come and the transport's losses to the monitor. Then ends the monitor's
/// interval, which began at `begin`.
void listen(bus::UdpTransport& transport, BusMonitor& monitor, base::Clock::time_point begin,
            base::Clock::time_point end, const std::atomic<bool>& interrupted);

/// Repeated display of a monitor's table on stdout. On a terminal a table replaces the table before
/// and is cut to the terminal's size. Elsewhere the tables follow each other. Keys are read on a
/// terminal.
class TableScreen {
 public:
  TableScreen();  ///< hides the cursor until destruction
  TableScreen(const TableScreen&) = delete;
  TableScreen& operator=(const TableScreen&) = delete;
  ~TableScreen();

  void show(const BusMonitor& monitor);

  /// Returns true if the user has typed q since the last call.
  [[nodiscard]] bool quit_wanted();

 private:
  bool terminal_;
  std::size_t height_ = 0;
  std::optional<termios> keyboard_;  ///< earlier settings; now keys come one by one, without echo
};

}  // namespace tachless::live
