#pragma once

#include <termios.h>

#include <cstddef>
#include <optional>

#include "monitor/bus_monitor.h"

namespace tachless::monitor {

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
