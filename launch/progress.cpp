#include "launch/progress.h"

#include <fmt/core.h>

#include <algorithm>

#include "report/summary.h"

namespace tachless::launch {
namespace {

constexpr int bar_width = 20;
constexpr std::chrono::milliseconds rate_window{500};

}  // namespace

Progress::Progress(std::int64_t num_ticks, double period_s, const std::string& robot)
    : num_ticks_(num_ticks), period_s_(period_s), before_(robot.empty() ? "" : robot + ": ") {}

void Progress::note(std::int64_t tick, double error_norm, Clock::time_point now) {
  if (tick < tick_) return;
  tick_ = tick;
  error_norm_ = error_norm;
  if (tick < 0) return;
  if (!rate_from_) {
    rate_from_ = {tick, now};
  } else if (now - rate_from_->at >= rate_window) {
    const double elapsed_s = std::chrono::duration<double>(now - rate_from_->at).count();
    ticks_per_s_ = static_cast<double>(tick - rate_from_->tick) / elapsed_s;
    rate_from_ = {tick, now};
  }
}

std::string Progress::line() const {
  if (tick_ < 0) return before_ + "waiting for the four processes to meet";
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

}  // namespace tachless::launch
