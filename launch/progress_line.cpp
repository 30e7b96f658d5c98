#include "launch/progress_line.h"

#include <fmt/core.h>
#include <unistd.h>

#include <iostream>

namespace tachless::launch {
namespace {

constexpr std::string_view clear_line = "\r\033[K";

}  // namespace

ProgressLine::ProgressLine(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

void ProgressLine::show(std::string_view what) const {
  if (quiet_) return;
  std::cerr << (terminal_ ? fmt::format("{}{} …", clear_line, what) : fmt::format("{}\n", what))
            << std::flush;
}

void ProgressLine::clear() const {
  if (terminal_ && !quiet_) std::cerr << clear_line << std::flush;
}

}  // namespace tachless::launch
