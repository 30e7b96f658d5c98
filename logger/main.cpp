#include "logger/node.h"
#include "node/options.h"
#include "node/run_role.h"

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = loop::Role::logger;
  return node::run_process(role, argc, argv, [](const node::ProcessOptions& options) {
    return node::run_role(role, options, [&](const auto& scenario, auto& link) {
      logger::run_node(scenario, link, options.log_path);
    });
  });
}
