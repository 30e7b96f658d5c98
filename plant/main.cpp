#include "node/options.h"
#include "node/run_role.h"
#include "plant/node.h"

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = loop::Role::plant;
  return node::run_process(role, argc, argv, [](const node::ProcessOptions& options) {
    return node::run_role(role, options, plant::run_node);
  });
}
