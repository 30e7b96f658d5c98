#pragma once

#include <sys/types.h>

#include <vector>

/// Other processes of this machine, as /proc shows them. Starts and ends none (child.h does).
namespace tachless::process {

/// Processes that `pid`'s main thread has started and not yet waited for; none when it is gone.
std::vector<pid_t> children_of(pid_t pid);

/// Whether it holds a socket; no when it is gone.
bool has_socket(pid_t pid);

/// Gives all threads of that process, and every child they start from now on, the scheduling class
/// SCHED_IDLE. Failure is harmless, and not reported.
void set_idle_priority(pid_t pid);

}  // namespace tachless::process
