#include "launch/screen.h"

#include <fmt/core.h>
#include <unistd.h>

#include <iostream>
#include <utility>

#include "diagnostics/text.h"

namespace tachless::launch {

Screen::Screen(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

void Screen::show(const Progress& progress) {
  const Clock::time_point now = Clock::now();
  if (quiet_ || now < next_) return;
  if (terminal_) {
    std::cerr << "\r\033[K" << progress.line() << std::flush;
    shown_ = true;
    next_ = now + std::chrono::milliseconds(100);
  } else {
    if (next_ != Clock::time_point{}) std::cerr << progress.line() + "\n" << std::flush;
    next_ = now + std::chrono::seconds(5);
  }
}

void Screen::clear() {
  if (std::exchange(shown_, false)) std::cerr << "\r\033[K" << std::flush;
}

void Screen::pass_on(std::string_view name, std::string_view line) {
  clear();
  const bool named = line.starts_with("tachless-");
  std::cerr << fmt::format("{}{}{}\n", named ? "" : name, named ? "" : ": ",
                           diagnostics::printable(line))
            << std::flush;
}

}  // namespace tachless::launch
