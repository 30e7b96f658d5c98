#include "launch/screen.h"

#include <fmt/core.h>
#include <unistd.h>

#include <iostream>

#include "diagnostics/text.h"

namespace tachless::launch {
namespace {

// A line that is too long for the terminal is cut, so that the next is where it is looked for.
constexpr const char* keep_lines = "\033[?7l";
constexpr const char* wrap_lines = "\033[?7h";

}  // namespace

Screen::Screen(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

void Screen::show(std::span<const Progress> all) {
  const Clock::time_point now = Clock::now();
  if (quiet_ || now < next_) return;
  if (terminal_) {
    std::string text = erasing() + keep_lines;
    for (const Progress& each : all) text += (shown_++ == 0 ? "" : "\n") + each.line();
    std::cerr << text + wrap_lines << std::flush;
    next_ = now + std::chrono::milliseconds(100);
  } else {
    for (const Progress& each : all) {
      if (next_ != Clock::time_point{}) std::cerr << each.line() + "\n" << std::flush;
    }
    next_ = now + std::chrono::seconds(5);
  }
}

void Screen::clear() { std::cerr << erasing() << std::flush; }

std::string Screen::erasing() {
  std::string text = shown_ == 0 ? "" : "\r\033[K";
  for (; shown_ > 1; --shown_) text += "\033[A\033[K";
  shown_ = 0;
  return text;
}

void Screen::pass_on(std::string_view before, std::string_view name, std::string_view line) {
  clear();
  const bool named = line.starts_with("tachless-");
  std::cerr << fmt::format("{}{}{}{}\n", before, named ? "" : name, named ? "" : ": ",
                           diagnostics::printable(line))
            << std::flush;
}

}  // namespace tachless::launch
