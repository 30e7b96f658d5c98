#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "controller/registry.h"
#include "messages/measurements.h"
#include "plant/arm_state.h"
#include "plant/drive.h"
#include "plant/robot_driver.h"
#include "scenario/scenario.h"

namespace tachless::in_process {

/// All that happened in one tick.
struct TickRecord {
  std::int64_t tick = 0;                 ///< from 0
  double time_s = 0;                     ///< tick times period
  plant::ArmState truth;                 ///< exact state at time_s
  messages::AnyMeasurement measurement;  ///< what the law is given
  messages::ReferencePoint reference;    ///< at time_s
  messages::TorqueCommand command;       ///< the law's
  messages::LawSignals controller;       ///< for the log
  plant::AppliedTorque applied;          ///< over this tick: delayed and limited
  /// Joints outside of their range or too fast, with plant.on_limit: warn.
  std::array<bool, max_joints> beyond_limit{};
};

/// The closed loop of a scenario stepped in this process, without bus, clock or memory of the past:
/// robot, reference and law are the very objects of the processes, called in the same order at
/// the same t_k = k h, so the records hold the bits that a lockstep run logs.
///
/// `law`: the scenario's, or the one of another program in its place; `driver`: a robot in the
/// emulator's place, whose time is the ticks.
///
/// Calls `on_tick` for ticks 0 to num_ticks - 1, with a record that is valid during the call; the
/// run ends early when it returns false.
/// @throw base::Failure(bad_usage) for a scenario that makes no sense,
/// base::Failure(protective_stop) naming tick and cause when a torque is not finite, a joint
/// is beyond its limits (plant.on_limit: stop) or the plant cannot be integrated on.
void run_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    const std::function<bool(const TickRecord&)>& on_tick,
                    plant::RobotDriver* driver = nullptr);
/// With `controller::scenario_law`, and its errors.
void run_in_process(const scenario::Scenario& scenario,
                    const std::function<bool(const TickRecord&)>& on_tick);

}  // namespace tachless::in_process
