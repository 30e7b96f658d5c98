#include "app/process_options.h"
#include "app/take_part.h"
#include "reference/node.h"

int main(int argc, char** argv) {
  constexpr auto role = bus::Role::reference;
  return app::run_process(role, argc, argv, [](const app::ProcessOptions& options) {
    return app::take_part(role, options, reference::run_node);
  });
}
