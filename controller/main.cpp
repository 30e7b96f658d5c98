#include "app/process_options.h"
#include "app/take_part.h"
#include "controller/node.h"

int main(int argc, char** argv) {
  constexpr auto role = bus::Role::controller;
  return app::run_process(role, argc, argv, [](const app::ProcessOptions& options) {
    return app::take_part(
        role, options,
        [&](const app::Scenario& scenario, bus::Transport& transport, app::Session& session) {
          controller::run_node(scenario, transport, session, options.resume);
        });
  });
}
