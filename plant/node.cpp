#include "plant/node.h"

#include "plant/lockstep_loop.h"

namespace plant {

void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session) {
  if (scenario.loop.mode != app::Mode::lockstep) {
    throw scenario.complaint("loop.mode", "realtime: not available yet; allowed: lockstep");
  }
  LockstepLoop(scenario, transport, session).run();
}

}  // namespace plant
