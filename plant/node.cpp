#include "plant/node.h"

#include "plant/lockstep_loop.h"
#include "plant/realtime_loop.h"

namespace tachless::plant {

void run_node(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    RealtimeLoop(scenario, transport, link).run();
  } else {
    LockstepLoop(scenario, transport, link).run();
  }
}

void run_driver(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link,
                RobotDriver& driver) {
  if (scenario.loop.mode != experiment::Mode::realtime) {
    throw scenario.complaint("loop.mode",
                             "lockstep; a real robot does not wait, so only realtime is allowed");
  }
  RealtimeLoop(scenario, transport, link, &driver).run();
}

}  // namespace tachless::plant
