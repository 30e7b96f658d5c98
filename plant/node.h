#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "plant/robot_driver.h"
#include "plant/simulator.h"
#include "scenario/scenario.h"
#include "session/session.h"

namespace tachless::plant {

/// Longest time for which the protective stop of a realtime run that ends early is recorded.
inline constexpr std::chrono::milliseconds longest_stop{500};

/// Runs the plant process: the emulated robot and the loop's clock. It publishes what the
/// controller measures, the TRUTH for the logger, and RUN_INFO. It advances with the commands that
/// it receives.
/// @throw base::Failure bad_usage (scenario), peer_lost (nobody answers), protocol_violated (two
/// processes command), protective_stop (the simulation diverged), and the failures of the session.
void run_node(const scenario::Scenario& scenario, session::Session& session);

/// Runs the plant process with a simulator in place of the emulator's mechanics, in lockstep and in
/// realtime (docs/plant.md).
/// @throw base::Failure as `run_node`; also bad_usage (a key of mechanics that the simulator
/// replaces) and protective_stop (the simulator threw)
void run_simulator(const scenario::Scenario& scenario, session::Session& session,
                   Simulator& simulator);

/// Runs the plant process with a real robot, in realtime (docs/real_robot.md).
/// @throw base::Failure as `run_node`; also bad_usage: lockstep, no torque limits, a robot that is
/// not at the scenario's initial position, or a robot that does not measure what the law needs
/// @throw base::Failure also protective_stop: a joint outside its range, or a fault of the driver
void run_driver(const scenario::Scenario& scenario, session::Session& session, RobotDriver& driver);

/// Function that makes the driver of a scenario's robot.
using MakeDriver = std::function<std::unique_ptr<RobotDriver>(const scenario::Scenario&)>;

/// Implements `main` of a driver's program. It makes the driver once, before it waits for the other
/// processes, and ends the driver last: `rest` is called until then. An exception of `make` is the
/// driver's failure: its text and exit code 2, or its own code if it is a base::Failure.
int driver_program(int argc, const char* const* argv, const MakeDriver& make);

}  // namespace tachless::plant
