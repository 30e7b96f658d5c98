#pragma once

#include <atomic>
#include <filesystem>
#include <vector>

/// This process: signal handling, CPUs, core dumps, network namespace, installation paths. What is
/// changed here stays so until the process ends.
namespace tachless::base {

/// From now on every signal that would end the process, can be handled and is not the report of an
/// error in the program (SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGALRM, SIGUSR1, … and the
/// real-time signals) sets the flag that is returned. A waiting system call ends early.
const std::atomic<bool>& catch_interruptions();

/// Gives this thread, and every one that it starts from now on, a nice value of 10: what runs at
/// the usual one comes first, and does not take everything. Failure is harmless, and not reported.
void set_low_priority();

/// From now on signals that could be delivered to any thread are not delivered to this one, nor to
/// those that it starts.
void leave_signals_to_others();

/// The CPUs that this process may use, in ascending order; never empty.
std::vector<int> allowed_cpus();

/// From now on this thread executes on these CPUs alone; without change when there are none.
/// @return false, and errno, when the system refuses
bool execute_on(const std::vector<int>& cpus);

/// From now on a write beyond the limit on file sizes (`ulimit -f`) fails with EFBIG instead of
/// ending the process.
void survive_file_size_limit();

/// From now on a write to a pipe without a reader fails, instead of ending the process.
void survive_broken_pipes();

/// Opens /dev/null as each of stdin, stdout and stderr that is closed, so that no other file gets
/// its number. For the start of a `main`.
void open_standard_streams();

/// Sends stdout and stderr to /dev/null from now on, each that cannot be written within a second:
/// nobody reads the pipe, or the terminal is stopped.
void give_up_blocked_output();

/// From now on this process leaves no core dump, and other processes of its user can neither trace
/// it nor read its memory. Programs that it starts are not concerned.
/// @throw std::system_error when the system refuses
void make_memory_private();

/// Moves this process, and every child it starts from now on, into a network namespace of its own
/// that has a loopback interface with a multicast route and nothing else: nothing leaks out,
/// nothing interferes. Needs no root where the kernel allows unprivileged user namespaces; the
/// process then is root in its namespace and the user it was outside. Call before any thread
/// starts.
/// @throw std::system_error with the step that failed and what to do
void enter_private_network();

/// Where this program and the others are: bin/ of a prefix that cmake/Install.cmake lays out; a
/// build directory looks the same.
std::filesystem::path program_directory();

/// Of scenarios/, templates and tachless_types.jar: share/tachless/ beside bin/. In a build
/// directory also of the script that builds and tests the tree.
std::filesystem::path shared_directory();

}  // namespace tachless::base
