#include "cli/progress.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <iostream>

#include "base/text.h"
#include "report/summary.h"

namespace tachless::cli {
namespace {

constexpr int bar_width = 20;
constexpr std::chrono::milliseconds rate_window{500};
constexpr std::chrono::seconds elsewhere{30};  // between lines where no terminal is
// A line that is too long for the terminal is cut, so that the next is where it is looked for.
constexpr const char* keep_lines = "\033[?7l";
constexpr const char* wrap_lines = "\033[?7h";

}  // namespace

Progress::Progress(std::int64_t num_ticks, double period_s, const std::string& robot)
    : num_ticks_(num_ticks), period_s_(period_s), before_(robot.empty() ? "" : robot + ": ") {}

void Progress::note(std::int64_t tick, double error_norm, Clock::time_point now) {
  if (tick < tick_) return;
  tick_ = tick;
  error_norm_ = error_norm;
  if (tick < 0) return;
  if (rate_from_ && now - rate_from_->at < rate_window) return;
  if (rate_from_) {
    const double elapsed_s = std::chrono::duration<double>(now - rate_from_->at).count();
    ticks_per_s_ = static_cast<double>(tick - rate_from_->tick) / elapsed_s;
  }
  rate_from_ = {tick, now};
}

std::string Progress::line() const {
  if (tick_ < 0) return before_ + "waiting for all four processes to join";
  const std::int64_t done = std::min(tick_ + 1, num_ticks_);
  const int filled = static_cast<int>(bar_width * done / num_ticks_);
  std::string bar(static_cast<std::size_t>(filled), '=');
  if (filled < bar_width) bar += '>';
  bar.resize(bar_width, ' ');
  return fmt::format(
      "{}{:.3f} of {:g} s  [{}]{}  |e| {:.1e} rad", before_, static_cast<double>(done) * period_s_,
      static_cast<double>(num_ticks_) * period_s_, bar,
      ticks_per_s_ ? fmt::format("  {} ticks/s", report::short_rate(*ticks_per_s_)) : "",
      error_norm_);
}

Screen::Screen(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

void Screen::show(std::string_view what) {
  if (quiet_) return;
  if (terminal_) {
    std::cerr << fmt::format("{}{} …", erasing(), what) << std::flush;
    shown_ = 1;
  } else if (const auto now = Progress::Clock::now(); now >= next_) {
    if (next_ != Progress::Clock::time_point{})
      std::cerr << fmt::format("{}\n", what) << std::flush;
    next_ = now + elsewhere;
  }
}

void Screen::show(std::span<const Progress> all) {
  const auto now = Progress::Clock::now();
  if (quiet_ || now < next_) return;
  if (terminal_) {
    std::string text = erasing() + keep_lines;
    for (const Progress& each : all) text += (shown_++ == 0 ? "" : "\n") + each.line();
    std::cerr << text + wrap_lines << std::flush;
    next_ = now + std::chrono::milliseconds(100);
  } else {
    for (const Progress& each : all) {
      if (next_ != Progress::Clock::time_point{}) std::cerr << each.line() + "\n" << std::flush;
    }
    next_ = now + elsewhere;
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
  std::cerr << fmt::format("{}{}: {}\n", before, name, base::printable(line)) << std::flush;
}

}  // namespace tachless::cli
