#pragma once

#include <cstdint>
#include <tuple>

#include "base/quantities.h"
#include "messages/field.h"

namespace tachless::messages::truth {

/// Kinds of torque that an arm reports.
enum class Told : std::int8_t { accepted = 1, measured = 2, both = 3 };

/// Torques that a real arm reported with its reading at the start of a tick. Only the logger
/// receives this message, in runs with a driver whose arm reports torques.
struct ArmTorque {
  /// Torque that the arm accepted and that acts, with the torque that the arm adds itself
  /// (robot.compensates) [N m; N]; zero: not reported.
  Vector accepted;
  /// Torque by sensors or currents, gravity included [N m; N]; zero: not reported.
  Vector measured;
  Told told = Told::both;

  using Value = ArmTorque;
  static constexpr std::string_view type = "tachless_truth.arm_torque_t", suffix = "ARM_TORQUE";
  static constexpr auto fields = std::tuple{
      per_joint("accepted", "tau_accepted", "N m", &Value::accepted,
                "torque that the arm took and that acted at the start of the tick"),
      per_joint("measured", "tau_measured", "N m", &Value::measured,
                "torque that the arm measured at the start of the tick, gravity included"),
      Field<Value, Told>{"told", "arm_torque_told", "", Kind::int8, Count::one, &Value::told,
                         "1 the arm tells the accepted torque, 2 the measured one, 3 both",
                         static_cast<double>(Told::accepted), static_cast<double>(Told::both)}};

  /// Returns true if the arm reports that torque.
  [[nodiscard]] bool tells(Told one) const {
    return (static_cast<int>(told) & static_cast<int>(one)) != 0;
  }
};

}  // namespace tachless::messages::truth
