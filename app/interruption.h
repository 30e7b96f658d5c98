#pragma once

#include <atomic>

namespace app {

/// From now on SIGINT, SIGTERM and SIGHUP set the flag that is returned, and interrupt a waiting
/// system call, instead of ending the process.
const std::atomic<bool>& catch_interruptions();

}  // namespace app
