#include "controller/node.h"
#include "node/process_options.h"
#include "node/run_role.h"

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = loop::Role::controller;
  return node::run_process(role, argc, argv, [](const node::ProcessOptions& options) {
    const auto run = [&](const experiment::Scenario& scenario, bus::Transport& transport,
                         node::Session& session) {
      controller::run_node(scenario, transport, session, options.controller.resume);
    };
    return node::run_role(role, options, run, run);
  });
}
