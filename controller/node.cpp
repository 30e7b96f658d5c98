#include "controller/node.h"

#include <utility>

#include "controller/lockstep_node.h"
#include "controller/realtime_node.h"

namespace tachless::controller {

void run_node(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
              node::Session& session, const std::optional<std::filesystem::path>& resume) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    run_realtime(scenario, std::move(law), transport, session);
  } else {
    run_lockstep(scenario, std::move(law), transport, session, resume);
  }
}

}  // namespace tachless::controller
