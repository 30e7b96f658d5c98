#pragma once

#include "bus/wire.h"

namespace tachless::node {

/// What a process of a realtime run asks of the kernel: memory that stays where it is (mlockall),
/// timers without slack, and, but for the logger, a scheduling class that nobody interrupts
/// (SCHED_FIFO). Where it is not permitted the process runs on without, and one line at level info
/// says what is missing and how to permit it. For the calling thread, before the run begins.
void request_real_time(loop::Role role);

}  // namespace tachless::node
