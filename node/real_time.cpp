#include "node/real_time.h"

#include <fmt/core.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "diagnostics/logging.h"

namespace tachless::node {
namespace {

/// Below the kernel's own threads (99). The plant, which sets the pace, comes first, then the
/// controller, which has to reply within the tick; the reference is a tick ahead.
int priority_of(loop::Role role) {
  switch (role) {
    case loop::Role::plant:
      return 80;
    case loop::Role::controller:
      return 79;
    case loop::Role::reference:
      return 78;
    case loop::Role::logger:
      return 0;
  }
  return 0;
}

}  // namespace

void request_real_time(loop::Role role) {
  std::string missing;
  ::prctl(PR_SET_TIMERSLACK, 1UL);  // [ns]; 50 us otherwise
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    missing += fmt::format("its memory locked ({}; `ulimit -l unlimited`)", std::strerror(errno));
  }
  if (const int priority = priority_of(role); priority > 0) {
    sched_param parameters{};
    parameters.sched_priority = priority;
    if (::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) != 0) {
      missing +=
          fmt::format("{}SCHED_FIFO priority {} ({}; `ulimit -r {}`)",
                      missing.empty() ? "" : " and ", priority, std::strerror(errno), priority);
    }
  }
  if (missing.empty()) return;
  diagnostics::log_info(
      "realtime without {}; for good: the lines `* - rtprio 90` and `* - memlock unlimited` in "
      "/etc/security/limits.d/realtime.conf, then log in again",
      missing);
}

}  // namespace tachless::node
