#include "plant/node.h"

#include "plant/lockstep_loop.h"
#include "plant/realtime_loop.h"

namespace plant {

void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session) {
  if (scenario.loop.mode == app::Mode::realtime) {
    RealtimeLoop(scenario, transport, session).run();
  } else {
    LockstepLoop(scenario, transport, session).run();
  }
}

}  // namespace plant
