#include "node/process_options.h"
#include "node/take_part.h"
#include "reference/node.h"

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = loop::Role::reference;
  return node::run_process(role, argc, argv, [](const node::ProcessOptions& options) {
    return node::take_part(role, options, reference::run_node);
  });
}
