// A KUKA LBR iiwa behind drake-iiwa-driver, as the plant of a run: docs/real_robot.md. Run
// drake-iiwa-driver with --torque_only --time_step=0.001 (the period of the scenario). Without
// --torque_only it holds the last torque when commands cease.

#include "iiwa_driver.h"
#include <tachless/plant/node.h>
#include <tachless/session/options.h>
#include <tachless/session/run_role.h>

using namespace tachless;

int main(int argc, char** argv) {
  constexpr auto role = messages::Role::plant;
  return session::run_process(role, argc, argv, [](const session::ProcessOptions& options) {
    iiwa::IiwaDriver driver(session::parse_lcm_url(options.lcm_url));
    return session::run_role(role, options, [&driver](const auto& scenario, auto& link) {
      if (scenario.robot.channel_prefix == "IIWA") {
        throw scenario.complaint("robot.name",
                                 "iiwa: IIWA_COMMAND is drake-iiwa-driver's; take another name");
      }
      plant::run_driver(scenario, link, driver);
    });
  });
}
