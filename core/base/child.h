#pragma once

#include <sys/types.h>

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/file_descriptor.h"

/// The one way to start another program or process. Who watches several at once: launch/supervise.
namespace tachless::base {

/// A process that was started here. Has to be waited for, with `take_end`.
struct Child {
  pid_t pid = -1;
  bool running = false;
  base::FileDescriptor output;  ///< its stdout and stderr; -1 once it has closed them
  std::string partial;          ///< the line that has not ended yet
};

/// How a process ended.
struct End {
  int exit_code = 0;  ///< when `signal` is 0
  int signal = 0;     ///< that killed it

  [[nodiscard]] bool well() const { return exit_code == 0 && signal == 0; }
};
/// "was killed by signal 9 (Killed)", "ended with exit code 3", "ended".
std::string text(const End& end);

/// Signals that this thread has blocked.
sigset_t blocked_signals();

/// Starts a program (a path, or a name on the search path) with its arguments, stdin empty, in a
/// process group of its own, so that Ctrl-C reaches this process alone. Should this process die, it
/// gets SIGTERM.
/// @param mask signals that it has blocked  @param cpus on which it may execute; empty: as this one
/// @param input descriptor that becomes its stdin in place of nothing; -1: none
/// @throw base::Failure(bad_usage) naming the program that cannot be started
Child start(const std::vector<std::string>& command, const sigset_t& mask = blocked_signals(),
            const std::vector<int>& cpus = {}, int input = -1);

/// Hands over each line that the process has written since the last call, without waiting. Once it
/// has ended and closed its output, that includes a last line without an end.
void read_lines(Child& child, const std::function<void(std::string)>& on_line);

/// How a running child has ended; nothing if it has not, or this has been asked before. Does not
/// wait unless `wait`.
std::optional<End> take_end(Child& child, bool wait = false);

using OnLine = std::function<void(std::string line)>;

/// Waits for a running child's end, at most `patience`, then kills it; kills in any case what it
/// has started and left in its process group. Its last lines are handed over.
/// @return how it ended
End end_within(Child& child, std::chrono::milliseconds patience, const OnLine& on_line);

/// How a program ended, and what it wrote.
struct Finished : End {
  std::vector<std::string> lines;
};

/// Runs a program as `start` does, to its end.
/// @throw base::Failure as `start`
Finished run(const std::vector<std::string>& command);

/// Finds an executable program of this name in the search path.
std::optional<std::filesystem::path> find_program(const std::string& name);

/// Replaces this process by a program (a path) with its arguments.
/// @throw base::Failure(bad_usage) naming the program and `remedy`
[[noreturn]] void become(const std::vector<std::string>& command, const std::string& remedy);

/// Whether `attempt`, made in a copy of this process, returns true there. What it does to its
/// process does not happen to this one.
bool works_in_a_copy(bool (*attempt)());

}  // namespace tachless::base
