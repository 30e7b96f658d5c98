#include "live/watch.h"

#include <fmt/core.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <string>
#include <thread>

#include "base/clock.h"

namespace tachless::live {

using base::Clock;

void drain(bus::UdpTransport& transport, const std::function<void(const bus::Datagram&)>& take) {
  const std::chrono::nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
  while (const auto datagram = transport.receive(Clock::time_point::min())) {
    take(*datagram);
    if (datagram->received_ns >= now.count()) break;
  }
}

void listen(bus::UdpTransport& transport, const std::function<void(const bus::Datagram&)>& take,
            Clock::time_point end, const std::atomic<bool>& interrupted) {
  while (!interrupted && Clock::now() < end) {
    drain(transport, take);
    std::this_thread::sleep_until(std::min(end, Clock::now() + std::chrono::milliseconds(1)));
  }
  if (!interrupted) drain(transport, take);
}

void listen(bus::UdpTransport& transport, BusMonitor& monitor, Clock::time_point begin,
            Clock::time_point end, const std::atomic<bool>& interrupted) {
  listen(
      transport, [&](const bus::Datagram& datagram) { monitor.take(datagram); }, end, interrupted);
  monitor.end_interval(base::seconds_of(Clock::now() - begin));
  monitor.set_statistics(transport.statistics());
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

void TableScreen::show(const BusMonitor& monitor) {
  winsize size{};
  if (!terminal_ || ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0) size = {};
  // The last row stays free, or the terminal would scroll.
  const auto lines = monitor.table(size.ws_row > 3 ? size.ws_row - 1U : 0U);
  std::string text;
  if (terminal_ && height_ > 0) text = fmt::format("\033[{}A\r", height_);
  if (terminal_) text += "\033[?7l";  // it cuts a line that is too long for it
  for (const std::string& line : lines) text += line + (terminal_ ? "\033[K\n" : "\n");
  if (terminal_) text += "\033[J\033[?7h";
  std::cout << text << std::flush;
  height_ = lines.size();
}

}  // namespace tachless::live
