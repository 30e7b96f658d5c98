#pragma once

#include <atomic>
#include <filesystem>

/// This process: which signals it bears, who sees its memory, which network it is in, and where the
/// files of its installation are. What is changed here stays so until its end.
namespace tachless::process {

/// From now on SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGPIPE (whoever reads the output has gone) set
/// the flag that is returned, instead of ending the process. A waiting system call ends early, or
/// with `flags` SA_RESTART goes on where it can (poll ends in any case): for a program whose
/// libraries do not bear an interrupted write.
const std::atomic<bool>& catch_interruptions(int flags = 0);

/// From now on a write beyond the limit on file sizes (`ulimit -f`) fails with EFBIG, and can be
/// told to the user, instead of ending the process.
void survive_file_size_limit();

/// From now on a write to a pipe that nobody reads fails, instead of ending the process.
void survive_broken_pipes();

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

}  // namespace tachless::process
