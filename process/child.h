#pragma once

#include <sys/types.h>
#include <csignal>

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "process/file_descriptor.h"

/// The one way to start another program or process. Who watches several at once: launch/supervise.
namespace tachless::process {

/// A process that was started here. Has to be waited for with `waitpid`.
struct Child {
  pid_t pid = -1;
  bool running = false;
  process::FileDescriptor output;  ///< its stdout and stderr; -1 once it has closed them
  std::string partial;             ///< the line that has not ended yet
};

/// Signals that this thread has blocked.
sigset_t blocked_signals();

/// Starts a program (a path, or a name on the search path) with its arguments, stdin empty, in a
/// process group of its own, so that Ctrl-C reaches this process alone. Should this process die, it
/// gets SIGTERM.
/// @param mask signals that it has blocked  @param cpus on which it may execute; empty: as this one
/// @param input descriptor that becomes its stdin in place of nothing; -1: none
/// @throw diagnostics::Failure(bad_usage) naming the program that cannot be started
Child start(const std::vector<std::string>& command, const sigset_t& mask = blocked_signals(),
            const std::vector<int>& cpus = {}, int input = -1);

/// Hands over each line that the process has written since the last call, without waiting. Once it
/// has ended and closed its output, that includes a last line without an end.
void read_lines(Child& child, const std::function<void(std::string)>& on_line);

/// How a program ended, and what it wrote.
struct Finished {
  int exit_code = 0;  ///< when `signal` is 0
  int signal = 0;     ///< that killed it
  std::vector<std::string> lines;

  [[nodiscard]] bool well() const { return exit_code == 0 && signal == 0; }
};

/// Runs a program as `start` does, to its end.
/// @throw diagnostics::Failure as `start`
Finished run(const std::vector<std::string>& command);

/// Where the search path has a program of this name that may be executed.
std::optional<std::filesystem::path> find_program(const std::string& name);

/// Replaces this process by a program (a path) with its arguments.
/// @throw diagnostics::Failure(bad_usage) naming the program and `remedy`
[[noreturn]] void become(const std::vector<std::string>& command, const std::string& remedy);

/// Whether `attempt`, made in a copy of this process, returns true there. What it does to its
/// process does not happen to this one.
bool works_in_a_copy(bool (*attempt)());

}  // namespace tachless::process
