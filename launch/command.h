#pragma once

namespace tachless::launch {

/// The whole of the `tachless` command: reads the command line, runs its verb, and turns a Failure
/// into one line on stderr and its exit code.
int tachless(int argc, const char* const* argv);

}  // namespace tachless::launch
