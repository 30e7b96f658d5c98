#pragma once

#include <cstddef>

#include "monitor/bus_monitor.h"

namespace tachless::monitor {

/// Shows a monitor's table on stdout again and again: on a terminal in place and cut to its size,
/// elsewhere one after the other.
class TableScreen {
 public:
  TableScreen();  ///< hides the cursor until destruction
  TableScreen(const TableScreen&) = delete;
  TableScreen& operator=(const TableScreen&) = delete;
  ~TableScreen();

  void show(BusMonitor& monitor);

 private:
  bool terminal_;
  std::size_t height_ = 0;
};

}  // namespace tachless::monitor
