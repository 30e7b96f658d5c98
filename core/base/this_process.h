#pragma once

#include <atomic>
#include <filesystem>
#include <vector>

/// This process: signals, CPUs, core dumps, network namespace, installation paths. Every change
/// lasts until the process ends.
namespace tachless::base {

/// Makes signals that would otherwise end the process set the returned flag: SIGINT, SIGTERM,
/// SIGHUP, SIGQUIT, SIGPIPE, SIGALRM, SIGUSR1, … and the real-time signals. Signals of errors in
/// the program still end it. A waiting system call ends early.
const std::atomic<bool>& catch_interruptions();

/// Lowers the priority (nice 10) of this thread and of the threads that it starts later. A failure
/// is ignored.
void set_low_priority();

/// Returns the CPUs that this process may use, in ascending order; never empty.
std::vector<int> allowed_cpus();

/// Restricts this thread to these CPUs. Changes nothing if there are none.
/// @return false, with errno, if the system refuses
bool execute_on(const std::vector<int>& cpus);

/// Lets a write beyond the limit on file sizes (`ulimit -f`) fail with EFBIG instead of ending the
/// process.
void survive_file_size_limit();

/// Lets a write to a pipe without a reader fail instead of ending the process.
void survive_broken_pipes();

/// Opens /dev/null as each of stdin, stdout and stderr that is closed, so that no other file gets
/// its number. Call it at the start of `main`.
void open_standard_streams();

/// Sends stdout and stderr to /dev/null from now on if they cannot be written within a second. In
/// that case nobody reads the pipe, or the terminal is stopped.
void give_up_blocked_output();

/// Forbids core dumps of this process, and forbids other processes of its user to trace it or to
/// read its memory. Programs that it starts are not affected.
/// @throw std::system_error if the system refuses
void make_memory_private();

/// Moves this process, and the children that it starts later, into a network namespace of its own.
/// The namespace has a loopback interface with a multicast route and nothing else. Needs no root if
/// the kernel allows unprivileged user namespaces. Call before any thread starts.
/// @throw std::system_error with the step that failed and what to do
void enter_private_network();

/// Returns the folder of this program and the others: bin/ of a prefix that cmake/Install.cmake
/// lays out; a build directory looks the same.
std::filesystem::path program_directory();

/// Returns the folder of scenarios/, templates and tachless_types.jar: share/tachless/ beside bin/.
/// In a build directory it is also the folder of the script that builds and tests the tree.
std::filesystem::path shared_directory();

}  // namespace tachless::base
