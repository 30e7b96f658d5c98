#pragma once

#include <sys/types.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/file_descriptor.h"

/// Functions that start, read and reap one child process. cli/supervise watches several at once.
namespace tachless::base {

/// A process that `start` started. `take_end` has to reap it.
struct Child {
  pid_t pid = -1;
  bool running = false;
  /// Stdout and stderr of the process; -1 once the process has closed them.
  base::FileDescriptor output;
  base::FileDescriptor notices;  ///< source of the child's notices; -1: not asked for
  std::string partial;           ///< the line that has not ended yet
};

/// Settings of a start.
struct StartOptions {
  std::optional<sigset_t> mask;  ///< signals that the child blocks; empty: as this thread
  std::vector<int> cpus;         ///< CPUs on which it may execute; empty: as this process
  int input = -1;                ///< descriptor that becomes its stdin; -1: /dev/null
  /// A process between the child and this process reads the child's pipe and never waits for this
  /// process. It keeps the newest 256 kB and drops older output. It reports the number of dropped
  /// bytes in a line that begins with `dropped_mark`.
  bool relayed = false;
  bool gives_notices = false;  ///< the child can report to `Child::notices`
};
inline constexpr std::string_view dropped_mark = "<dropped> ";

/// Event that a robot's driver reports with `give_notice`.
enum class Notice : char { robot_starts = 's', robot_stopped = 'e' };

/// Reports to the process that started this one with `gives_notices`; does nothing without one.
/// Never waits.
void give_notice(Notice notice) noexcept;

/// End of a process.
struct End {
  int exit_code = 0;  ///< valid when `signal` is 0
  int signal = 0;     ///< signal that killed the process; 0: none

  [[nodiscard]] bool well() const { return exit_code == 0 && signal == 0; }
};
/// Returns "was killed by signal 9 (Killed)", "ended with exit code 3" or "ended".
std::string text(const End& end);

/// Returns the signals that this thread has blocked.
sigset_t blocked_signals();

/// Starts a program (a path, or a name on the search path) with its arguments. The child has its
/// own process group, so that Ctrl-C reaches this process alone. The child gets SIGTERM when this
/// process dies. Any thread may call this; the child does not end with the thread.
/// @throw base::Failure(bad_usage) naming the program that cannot be started
Child start(const std::vector<std::string>& command, const StartOptions& options = {});

/// Passes to `on_line` each line that the process has written since the last call, but reads at
/// most 64 kB. Does not wait. A last line without an end follows once the process has ended.
/// @return true if there may be more
bool read_lines(Child& child, const std::function<void(std::string)>& on_line);

/// Reads the rest of the output of a child that has ended. Reads for at most `patience` if another
/// process holds the pipe.
void read_rest(Child& child, std::chrono::milliseconds patience,
               const std::function<void(std::string)>& on_line);

/// Returns the notices since the last call. Does not wait.
std::vector<Notice> take_notices(Child& child);

/// Returns the end of a running child. Returns nothing while it runs, and after the first call that
/// returned the end. Waits only with `wait`.
std::optional<End> take_end(Child& child, bool wait = false);

using OnLine = std::function<void(std::string line)>;

/// Waits for a running child's end, at most `patience`, then kills it. Always kills the rest of the
/// child's process group. Passes the child's last lines to `on_line`.
/// @return its end
End end_within(Child& child, std::chrono::milliseconds patience, const OnLine& on_line);

/// End of a program, with its output.
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

/// Runs `attempt` in a forked child and returns its result. Side effects stay in the child.
bool works_in_a_copy(bool (*attempt)());

}  // namespace tachless::base
