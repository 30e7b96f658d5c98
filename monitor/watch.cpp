#include "monitor/watch.h"

#include <fmt/core.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <string>
#include <utility>

#include "bus/socket.h"
#include "diagnostics/time.h"

namespace tachless::monitor {

using loop::Clock;

void Listener::listen(Clock::time_point begin, Clock::time_point end) {
  while (!interrupted_ && Clock::now() < end) {
    const Clock::time_point now = Clock::now();
    const double since_s = diagnostics::seconds_of(now - std::exchange(last_drain_, now));
    // A quarter of the buffer has to hold what comes in one nap.
    const double held_s =
        0.25 * transport_.receive_buffer_bytes() * since_s / std::max(drain(end), 1.0);
    const Clock::duration held = diagnostics::nanoseconds_of(std::min(held_s, 1.0));
    nap_ = std::clamp<Clock::duration>(std::min(held, 2 * nap_), shortest_nap, longest_nap);
    if (!interrupted_) bus::poll_until({}, std::min(end, Clock::now() + nap_));
  }
  drain_what_came_before_now();
  monitor_.end_interval(diagnostics::seconds_of(Clock::now() - begin));
  monitor_.set_statistics(transport_.statistics());
}

/// @return bytes of the socket's buffer that what was taken has filled
double Listener::drain(Clock::time_point end) {
  constexpr std::size_t kernel_bytes_per_datagram = 1024;  // bookkeeping, at least doubled
  constexpr std::uint64_t between_looks = 256;
  std::uint64_t count = 0;
  std::size_t bytes = 0;
  while (const auto datagram = transport_.receive(Clock::time_point::min())) {
    monitor_.take(*datagram);
    bytes += datagram->payload.size() + kernel_bytes_per_datagram;
    if (++count % between_looks == 0 && (interrupted_ || Clock::now() >= end)) break;
  }
  return static_cast<double>(bytes);
}

/// Takes everything that has arrived by now, also when this process reads late.
void Listener::drain_what_came_before_now() {
  const std::chrono::nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
  while (const auto datagram = transport_.receive(Clock::time_point::min())) {
    monitor_.take(*datagram);
    if (datagram->received_ns >= now.count()) break;
  }
}

TableScreen::TableScreen() : terminal_(isatty(STDOUT_FILENO) == 1) {
  if (!terminal_) return;
  std::cout << "\033[?25l" << std::flush;
  termios keys{};
  if (tcgetattr(STDIN_FILENO, &keys) != 0) return;
  keyboard_ = keys;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  tcsetattr(STDIN_FILENO, TCSANOW, &keys);
}

TableScreen::~TableScreen() {
  if (terminal_) std::cout << "\033[?25h" << std::flush;
  if (keyboard_) tcsetattr(STDIN_FILENO, TCSANOW, &*keyboard_);
}

bool TableScreen::quit_wanted() {
  bool wanted = false;
  pollfd keys{STDIN_FILENO, POLLIN, 0};
  char key = 0;
  while (keyboard_ && poll(&keys, 1, 0) > 0 && read(STDIN_FILENO, &key, 1) == 1) {
    wanted = wanted || key == 'q';
  }
  return wanted;
}

void TableScreen::show(BusMonitor& monitor) {
  winsize size{};
  if (!terminal_ || ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0) size = {};
  // The last row stays free, or the terminal would scroll.
  const auto lines = monitor.table(size.ws_col, size.ws_row > 3 ? size.ws_row - 1U : 0U);
  std::string text;
  if (terminal_ && height_ > 0) text = fmt::format("\033[{}A\r", height_);
  for (const std::string& line : lines) text += line + (terminal_ ? "\033[K\n" : "\n");
  if (terminal_) text += "\033[J";
  std::cout << text << std::flush;
  height_ = lines.size();
}

}  // namespace tachless::monitor
