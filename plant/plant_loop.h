#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/clock.h"
#include "messages/messages.h"
#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "plant/guarded_robot.h"
#include "plant/robot_driver.h"
#include "scenario/scenario.h"
#include "session/session.h"

namespace tachless::plant {

/// Base of the plant's two loops: the robot, and the messages about it. It does not know when a
/// tick begins.
class PlantLoop {
 protected:
  using Time = base::Clock::time_point;
  using Bytes = std::span<const std::byte>;

  /// @param driver driver of a real robot, which outlives this object; null: the arm is emulated
  /// @param simulator mechanics in place of the emulator's own, which outlive this object; null:
  /// none
  PlantLoop(const scenario::Scenario& scenario, session::Session& session, RobotDriver* driver,
            Simulator* simulator);

  /// Chooses the measurement and publishes RUN_INFO, once the others have joined. The logger writes
  /// its own RUN_INFO; this one is for lcm-logger.
  /// @throw base::Failure(bad_usage) when the robot does not measure what the law needs,
  /// (protocol_violated) when there is no such measurement.
  void prepare();

  /// Returns the stamp of t_k = k h in this run. Its time is not a sum of periods.
  [[nodiscard]] messages::Stamp stamp(std::int64_t tick) const;

  struct Request {
    Time sent;
    Bytes measurement, tick;
  };
  /// Publishes TICK with that stamp and the measurement of the robot's last reading. A tick without
  /// a reading has TICK alone. The bytes are valid until the next call.
  /// @throw base::Failure(protective_stop) when the state is not finite.
  Request publish_request(const messages::Stamp& tick_stamp);
  struct Truth {
    Bytes truth, contact;  ///< empty: not published
  };
  /// Publishes the robot's state at the beginning of the tick and the torque over it. With
  /// plant.mujoco it publishes the contact first. For a real arm it publishes the torques that the
  /// arm reports first. Call it once per tick, because it counts saturation. A tick without a
  /// reading has no state and no TRUTH.
  /// @return the bytes, valid until the next call
  /// @throw base::Failure(protective_stop) when the state is not finite.
  Truth publish_truth(std::int64_t tick, messages::truth::DriveFault fault);
  /// Announces and counts the tick as over.
  void note_completed(std::int64_t tick);

  /// Inspects a decoded command before it is accepted or dropped.
  /// @throw base::Failure(protective_stop) if this run's controller commands a torque that is not
  /// finite
  void require_finite(messages::Rejection rejection, const bus::Datagram& command) const;

  const scenario::Scenario& scenario_;
  session::Session& session_;
  GuardedRobot robot_;
  std::string prefix_;  ///< prefix of the robot's channels
  messages::Layout layout_;
  messages::Port<messages::Tick> tick_port_;
  messages::Port<messages::TorqueCommand> command_port_;
  messages::Port<messages::truth::PlantTruth> truth_port_;
  std::optional<messages::Port<messages::truth::Contact>> contact_port_;  ///< set with plant.mujoco
  messages::Port<messages::truth::ArmTorque> arm_torque_port_;
  std::optional<messages::Port<messages::AnyMeasurement>> measurement_port_;  ///< set by `prepare`
};

/// Runs the plant in simulation time: joins, runs all ticks and leaves. The plant advances only
/// with the command for its tick.
void run_lockstep(const scenario::Scenario& scenario, session::Session& session,
                  Simulator* simulator);

/// Runs the plant on the wall clock. Tick k begins at the absolute deadline start + k h, whether
/// its command has come or not. No tick is left out: late ticks follow as fast as possible, each
/// with half a period for its command. A missed command holds the last torque.
///
/// Too many missed commands in a row, or any other cause that ends the run early, make a protective
/// stop first: drives without torque, braking. The stop is recorded for `longest_stop` at most. The
/// statistics get a fault with exit code 1 when more deadlines were missed than the scenario
/// allows. A robot that is the clock begins the ticks itself. Its missed deadlines are those of the
/// robot's ticks, by the robot's own time, that got no answer.
void run_realtime(const scenario::Scenario& scenario, session::Session& session,
                  RobotDriver* driver, Simulator* simulator);

}  // namespace tachless::plant
