#pragma once

#include <unistd.h>

#include <iostream>
#include <string>

namespace tachless::soak {

/// One line on stderr that is replaced where it is a terminal.
class Progress {
 public:
  explicit Progress(bool quiet) : quiet_(quiet) {}

  void show(const std::string& text) const {
    if (quiet_) return;
    std::cerr << (terminal_ ? "\r\033[K" : "") << text << (terminal_ ? "" : "\n") << std::flush;
  }
  void clear() const {
    if (terminal_ && !quiet_) std::cerr << "\r\033[K" << std::flush;
  }

 private:
  bool quiet_;
  bool terminal_ = isatty(STDERR_FILENO) == 1;
};

}  // namespace tachless::soak
