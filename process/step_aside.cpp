#include "process/step_aside.h"

#include <sched.h>

#include "process/process_tree.h"

namespace tachless::process {

void step_aside(pid_t process) {
  const sched_param none{};
  for (const pid_t thread : threads_of(process)) {
    [[maybe_unused]] const int refused = sched_setscheduler(thread, SCHED_IDLE, &none);
  }
}

}  // namespace tachless::process
