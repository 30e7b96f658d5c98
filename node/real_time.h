#pragma once

#include "loop/messages.h"

namespace tachless::node {

/// What a process of a realtime run requests of the kernel, for the calling thread, before the run
/// begins: memory that is not paged out (mlockall), timers without slack, and, for all roles but
/// the logger, the scheduling class SCHED_FIFO, which no ordinary process preempts. Without the
/// permission the process runs all the same, and one line at level info says what is missing and
/// how to permit it.
void request_real_time(loop::Role role);

}  // namespace tachless::node
