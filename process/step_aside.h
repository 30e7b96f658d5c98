#pragma once

#include <sys/types.h>

namespace tachless::process {

/// From now on all threads of that process, and every child they start, run only when nobody else
/// wants the processor. Failure is harmless, and not reported.
void step_aside(pid_t process);

}  // namespace tachless::process
