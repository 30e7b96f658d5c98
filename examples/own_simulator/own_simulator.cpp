// Mechanics in the emulator's place: docs/plant.md.

#include <tachless/plant/node.h>
#include <tachless/plant/plant_model.h>
#include <tachless/session/options.h>
#include <tachless/session/run_role.h>
#include "arm_at_a_wall.h"

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = messages::Role::plant;
  return session::run_process(role, argc, argv, [](const session::ProcessOptions& options) {
    return session::run_role(role, options, [](const auto& scenario, auto& link) {
      own_simulator::ArmAtAWall arm(plant::plant_model(scenario));
      plant::run_simulator(scenario, link, arm);
    });
  });
}
