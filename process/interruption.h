#pragma once

#include <atomic>

namespace tachless::process {

/// From now on SIGINT, SIGTERM and SIGHUP set the flag that is returned, and interrupt a waiting
/// system call, instead of ending the process.
const std::atomic<bool>& catch_interruptions();

/// From now on a write beyond the limit on file sizes (`ulimit -f`) fails with EFBIG, and can be
/// told to the user, instead of ending the process.
void survive_file_size_limit();

}  // namespace tachless::process
