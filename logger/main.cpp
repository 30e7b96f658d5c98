#include "app/process_options.h"
#include "app/take_part.h"
#include "logger/node.h"

int main(int argc, char** argv) {
  constexpr auto role = bus::Role::logger;
  return app::run_process(role, argc, argv, [](const app::ProcessOptions& options) {
    return app::take_part(role, options, [&](const auto& scenario, auto& transport, auto& session) {
      logger::run_node(scenario, transport, session, options.log_path);
    });
  });
}
