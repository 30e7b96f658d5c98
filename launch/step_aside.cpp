#include "launch/step_aside.h"

#include <sched.h>

namespace launch {

void step_aside() {
  const sched_param none{};
  [[maybe_unused]] const int refused = sched_setscheduler(0, SCHED_IDLE, &none);
}

}  // namespace launch
