#include "controller/node.h"

#include "controller/catalogue.h"
#include "controller/law_node.h"

namespace controller {

void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session) {
  with_law(scenario,
           [&]<class L>(const L& law) { LawNode<L>(scenario, law, transport, session).run(); });
}

}  // namespace controller
