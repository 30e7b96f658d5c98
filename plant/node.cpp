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

void run_driver(const app::Scenario& scenario, bus::Transport& transport, app::Session& session,
                RobotDriver& driver) {
  if (scenario.loop.mode != app::Mode::realtime) {
    throw scenario.complaint("loop.mode",
                             "lockstep; a real robot does not wait, so only realtime is allowed");
  }
  RealtimeLoop(scenario, transport, session, &driver).run();
}

}  // namespace plant
