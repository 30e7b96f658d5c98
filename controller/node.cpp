#include "controller/node.h"

#include "controller/catalogue.h"
#include "controller/lockstep_node.h"
#include "controller/realtime_node.h"

namespace tachless::controller {

void run_node(const experiment::Scenario& scenario, bus::Transport& transport,
              node::Session& session, const std::optional<std::filesystem::path>& resume) {
  with_law(scenario, [&]<class L>(const L& /*law*/) {
    if (scenario.loop.mode == experiment::Mode::realtime) {
      RealtimeNode<L>(scenario, transport, session).run();
    } else {
      LockstepNode<L>(scenario, transport, session).run(resume);
    }
  });
}

}  // namespace tachless::controller
