#pragma once

#include "app/scenario.h"
#include "app/session.h"
#include "bus/transport.h"
#include "plant/robot_driver.h"

namespace plant {

/// The plant process: the emulated robot and the loop's clock. Publishes what the controller
/// measures, the TRUTH for the logger and RUN_INFO; advances with the commands that come back.
/// @throw app::Failure bad_usage (scenario), peer_lost (nobody answers), protocol_violated (two
/// processes command), protective_stop (the simulation diverged), and whatever the session says.
void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session);

/// The same with a real robot, in realtime: docs/real_robot.md.
/// @throw app::Failure also bad_usage (lock-step; no torque limits; the robot is not where the
/// scenario begins, or does not measure what the law needs) and protective_stop (a joint outside of
/// its range, or whatever the driver says).
void run_driver(const app::Scenario& scenario, bus::Transport& transport, app::Session& session,
                RobotDriver& driver);

}  // namespace plant
