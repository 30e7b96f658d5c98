#include "app/process_options.h"
#include "app/take_part.h"
#include "plant/node.h"

int main(int argc, char** argv) {
  constexpr auto role = bus::Role::plant;
  return app::run_process(role, argc, argv, [](const app::ProcessOptions& options) {
    return app::take_part(role, options, plant::run_node);
  });
}
