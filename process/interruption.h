#pragma once

#include <atomic>

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

}  // namespace tachless::process
