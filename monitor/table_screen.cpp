#include "monitor/table_screen.h"

#include <fmt/core.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <iostream>

namespace tachless::monitor {

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
