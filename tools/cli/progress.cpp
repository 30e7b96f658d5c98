#include "cli/progress.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

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

Progress::Progress(std::int64_t num_ticks, double period_s, std::string unit,
                   const std::string& robot)
    : num_ticks_(num_ticks),
      period_s_(period_s),
      unit_(std::move(unit)),
      before_(robot.empty() ? "" : robot + ": ") {}

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
      "{}{:.3f} of {:g} s  [{}]{}  |e| {:.1e} {}", before_, static_cast<double>(done) * period_s_,
      static_cast<double>(num_ticks_) * period_s_, bar,
      ticks_per_s_ ? fmt::format("  {} ticks/s", report::short_rate(*ticks_per_s_)) : "",
      error_norm_, unit_);
}

LaggingOutput::LaggingOutput(int descriptor) : descriptor_(descriptor) {
  struct stat file {};
  if (fstat(descriptor, &file) != 0 || (!S_ISFIFO(file.st_mode) && !S_ISCHR(file.st_mode))) return;
  // The flag belongs to the open file, which other processes share.
  own_ = base::FileDescriptor(::open(fmt::format("/proc/self/fd/{}", descriptor).c_str(),
                                     O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
}

LaggingOutput::~LaggingOutput() {
  std::string_view rest = waiting_;
  while (!rest.empty()) {
    const ssize_t written = ::write(descriptor_, rest.data(), rest.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return;
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
}

void LaggingOutput::put(std::string_view text) {
  constexpr std::size_t most_waiting = 1U << 16;
  if (waiting_.size() + text.size() > most_waiting) {
    ++dropped_;
  } else {
    waiting_ += text;
  }
  flush();
}

bool LaggingOutput::flush() {
  const int target = own_.get() >= 0 ? own_.get() : descriptor_;
  while (!waiting_.empty()) {
    // A descriptor that may wait takes no more than a pipe that is ready has place for.
    pollfd output{target, POLLOUT, 0};
    if (poll(&output, 1, 0) != 1) break;
    const std::size_t most = own_.get() >= 0 ? waiting_.size() : std::size_t{512};
    const ssize_t written = ::write(target, waiting_.data(), std::min(most, waiting_.size()));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0 && errno == EAGAIN) break;
    if (written < 0) waiting_.clear();  // nobody can read it any more
    if (written > 0) waiting_.erase(0, static_cast<std::size_t>(written));
  }
  if (waiting_.empty() && dropped_ > 0) {
    waiting_ = fmt::format("tachless: {} lines were not shown, because nobody read them\n",
                           std::exchange(dropped_, 0));
    return flush();
  }
  return !waiting_.empty();
}

Screen::Screen(bool quiet)
    : out_(STDERR_FILENO), quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

void Screen::show(std::string_view what) {
  if (quiet_) return;
  if (terminal_) {
    out_.put(fmt::format("{}{} …", erasing(), what));
    shown_ = 1;
  } else if (const auto now = Progress::Clock::now(); now >= next_) {
    if (next_ != Progress::Clock::time_point{}) out_.put(fmt::format("{}\n", what));
    next_ = now + elsewhere;
  }
}

void Screen::show(std::span<const Progress> all) {
  const auto now = Progress::Clock::now();
  if (out_.flush() || quiet_ || now < next_) return;
  if (terminal_) {
    std::string text = erasing() + keep_lines;
    for (const Progress& each : all) text += (shown_++ == 0 ? "" : "\n") + each.line();
    out_.put(text + wrap_lines);
    next_ = now + std::chrono::milliseconds(100);
  } else {
    for (const Progress& each : all) {
      if (next_ != Progress::Clock::time_point{}) out_.put(each.line() + "\n");
    }
    next_ = now + elsewhere;
  }
}

void Screen::clear() { out_.put(erasing()); }

std::string Screen::erasing() {
  std::string text = shown_ == 0 ? "" : "\r\033[K";
  for (; shown_ > 1; --shown_) text += "\033[A\033[K";
  shown_ = 0;
  return text;
}

void Screen::pass_on(std::string_view before, std::string_view name, std::string_view line) {
  clear();
  out_.put(fmt::format("{}{}: {}\n", before, name, base::printable(line)));
}

}  // namespace tachless::cli
