#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "controller/registry.h"
#include "messages/measurements.h"
#include "plant/arm_state.h"
#include "plant/drive.h"
#include "plant/robot_driver.h"
#include "plant/simulator.h"
#include "scenario/scenario.h"

namespace tachless::in_process {

/// Everything that happened in one tick.
struct TickRecord {
  std::int64_t tick = 0;                 ///< number of the tick, from 0
  double time_s = 0;                     ///< tick times period
  plant::ArmState truth;                 ///< exact state at time_s
  messages::AnyMeasurement measurement;  ///< measurement that the law receives
  messages::ReferencePoint reference;    ///< reference at time_s
  messages::TorqueCommand command;       ///< command of the law
  messages::LawSignals controller;       ///< signals of the law for the log
  plant::AppliedTorque applied;          ///< torque over this tick, delayed and limited
  /// Joints outside their range or above their speed limit, with plant.on_limit: warn.
  std::array<bool, max_joints> beyond_limit{};
};

/// Steps the closed loop of a scenario in this process, without a bus and without a clock. The
/// robot, reference and law are the same objects as in the separate programs. They are called in
/// the same order at the same t_k = k h, so the records equal a lockstep run's log bit for bit. The
/// loop keeps no state between calls.
///
/// Calls `on_tick` for ticks 0 to num_ticks - 1 with a record that is valid during the call. The
/// run ends early when `on_tick` returns false.
/// @param law the scenario's law, or another program's law in its place
/// @param driver a robot that replaces the emulator and counts its time in ticks; null: the
/// emulator
/// @throw base::Failure(bad_usage) for an inconsistent scenario
/// @throw base::Failure(protective_stop), naming tick and cause, when a torque is not finite, a
/// joint exceeds its limits (plant.on_limit: stop) or the plant's integration fails
void run_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    const std::function<bool(const TickRecord&)>& on_tick,
                    plant::RobotDriver* driver = nullptr);
/// Calls `run_in_process` with a simulator in place of the emulator's mechanics.
void run_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    const std::function<bool(const TickRecord&)>& on_tick,
                    plant::Simulator& simulator);
/// Calls `run_in_process` with the law that `controller::scenario_law` makes; throws its errors
/// too.
void run_in_process(const scenario::Scenario& scenario,
                    const std::function<bool(const TickRecord&)>& on_tick);

}  // namespace tachless::in_process
