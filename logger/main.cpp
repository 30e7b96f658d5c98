#include "logger/node.h"
#include "session/options.h"
#include "session/run_role.h"

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = messages::Role::logger;
  return session::run_process(role, argc, argv, [](const session::ProcessOptions& options) {
    return session::run_role(role, options, [&](const auto& scenario, auto& session) {
      logger::run_node(scenario, session, options.log_path);
    });
  });
}
