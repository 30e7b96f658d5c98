#pragma once

#include <sys/types.h>

#include <vector>

/// Other processes of this machine, as /proc shows them. Starts and ends none (child.h does).
namespace tachless::process {

/// Processes that `pid`'s main thread has started and not yet waited for; none when it is gone.
std::vector<pid_t> children_of(pid_t pid);

/// Whether it holds a socket; no when it is gone.
bool has_socket(pid_t pid);

/// From now on all threads of that process, and every child they start, run only when nobody else
/// wants the processor. Failure is harmless, and not reported.
void step_aside(pid_t pid);

}  // namespace tachless::process
