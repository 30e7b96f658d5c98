#pragma once

#include <sys/types.h>
#include <csignal>

#include <functional>
#include <string>
#include <vector>

#include "process/file_descriptor.h"

namespace tachless::process {

/// A process that was started here. Has to be waited for with `waitpid`.
struct Child {
  pid_t pid = -1;
  bool running = false;
  process::FileDescriptor output;  ///< its stdout and stderr; -1 once it has closed them
  std::string partial;             ///< the line that has not ended yet
};

/// Starts a program (a path) with its arguments, in a process group of its own, so that Ctrl-C
/// reaches this process alone. Should this process die, it gets SIGTERM.
/// @param mask signals that it has blocked
/// @throw diagnostics::Failure(bad_usage) naming the program that cannot be started
Child start(const std::vector<std::string>& command, const sigset_t& mask);

/// Hands over each line that the process has written since the last call, without waiting. Once it
/// has ended and closed its output, that includes a last line without an end.
void read_lines(Child& child, const std::function<void(std::string)>& on_line);

}  // namespace tachless::process
