#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>

/// A fault of a user's program, for stopping_test.cpp. The environment says which: FAULT is the
/// function and what it does, "read block"; FAULT_AT is the number of the call; NOTES is the file
/// that lists what happened, in order.
namespace tachless::system_test {

inline constexpr std::chrono::milliseconds blocked_for{2500};

inline std::string setting(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// Adds a line to NOTES.
inline void note(const std::string& event) {
  static const std::string path = setting("NOTES");
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  const std::string line = event + "\n";
  [[maybe_unused]] const ssize_t written = ::write(file, line.data(), line.size());
  ::close(file);
}

/// Writes as fast as its reader reads.
inline void flood(std::size_t bytes) {
  static std::array<char, 1U << 16> lines;
  for (std::size_t i = 0; i < lines.size(); ++i) lines[i] = i % 64 == 63 ? '\n' : 'x';
  for (std::size_t done = 0; done < bytes; done += lines.size()) {
    if (::write(STDOUT_FILENO, lines.data(), lines.size()) < 0) return;
  }
}

/// Does at call FAULT_AT of `function` (at the first one of start and stop) what FAULT says.
inline void fault_of(std::string_view function, bool once = false) {
  static const std::string wanted = setting("FAULT");
  static const int wanted_call = std::stoi(setting("FAULT_AT"));
  static int calls = 0;
  if (!wanted.starts_with(std::string(function) + " ")) return;
  const std::string_view what = std::string_view(wanted).substr(function.size() + 1);
  ++calls;
  if (what == "chatter") {
    constexpr std::string_view line =
        "a line that somebody prints at every tick while he looks for an error in his program\n";
    [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, line.data(), line.size());
  }
  if (calls != (once ? 1 : wanted_call)) return;
  note("fault");
  if (what == "block") std::this_thread::sleep_for(blocked_for);
  if (what == "throw") throw std::runtime_error("drive 2 is too hot");
  if (what == "exit") ::_exit(7);
  if (what == "kill") ::raise(SIGKILL);
  if (what == "flood") flood(std::size_t{32} << 20);
}

}  // namespace tachless::system_test
