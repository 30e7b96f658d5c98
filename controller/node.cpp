#include "controller/node.h"

#include "controller/lockstep_node.h"
#include "controller/realtime_node.h"

namespace tachless::controller {

void run_node(const experiment::Scenario& scenario, bus::Transport& transport,
              node::Session& session, const std::optional<std::filesystem::path>& resume) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    run_realtime(scenario, transport, session);
  } else {
    run_lockstep(scenario, transport, session, resume);
  }
}

}  // namespace tachless::controller
