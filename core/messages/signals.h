#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "base/quantities.h"
#include "messages/field.h"

/// The values that the processes of the loop exchange, without ticks or times. The nodes add ticks
/// and times. Each measurement has its own type, without inheritance or conversion. A law therefore
/// receives only what its type holds.
namespace tachless::messages {

/// Measurement of an output-feedback law of a rigid robot.
struct PositionMeasurement {
  Vector q;  ///< link position [rad; m]

  static constexpr std::string_view type = "tachless.position_measurement_t", suffix = "POSITION";
  static constexpr auto fields =
      std::tuple{per_joint("position", "q", "rad", &PositionMeasurement::q, "link position")};
};

/// Measurement of an output-feedback law of a flexible-joint robot with motor encoders.
struct MotorPositionMeasurement {
  Vector theta;  ///< motor position, on the link side of the gear [rad]

  static constexpr std::string_view type = "tachless.motor_position_measurement_t",
                                    suffix = "MOTOR_POSITION";
  static constexpr auto fields = std::tuple{per_joint(
      "motor_position", "theta", "rad", &MotorPositionMeasurement::theta, "motor position")};
};

/// Measurement of an output-feedback law of a flexible-joint robot with encoders on both sides.
struct BothPositionsMeasurement {
  Vector q;      ///< link position [rad; m]
  Vector theta;  ///< motor position, on the link side of the gear [rad]

  using Value = BothPositionsMeasurement;
  static constexpr std::string_view type = "tachless.both_positions_measurement_t",
                                    suffix = "BOTH_POSITIONS";
  static constexpr auto fields =
      std::tuple{per_joint("position", "q", "rad", &Value::q, "link position"),
                 per_joint("motor_position", "theta", "rad", &Value::theta, "motor position")};
};

/// Measurement of the flexible-joint law of Loria and Ortega (eq. 9-12), without motor velocity.
struct LinkStateMeasurement {
  Vector q;      ///< link position [rad; m]
  Vector v;      ///< link velocity [rad/s; m/s]
  Vector theta;  ///< motor position [rad]

  using Value = LinkStateMeasurement;
  static constexpr std::string_view type = "tachless.link_state_measurement_t",
                                    suffix = "LINK_STATE";
  static constexpr auto fields =
      std::tuple{per_joint("position", "q", "rad", &Value::q, "link position"),
                 per_joint("velocity", "v", "rad/s", &Value::v, "link velocity"),
                 per_joint("motor_position", "theta", "rad", &Value::theta, "motor position")};
};

/// Full state. On a rigid robot `theta` and `thetadot` are empty.
struct StateMeasurement {
  Vector q;         ///< link position [rad; m]
  Vector v;         ///< link velocity [rad/s; m/s]
  Vector theta;     ///< motor position [rad]
  Vector thetadot;  ///< motor velocity [rad/s]

  using Value = StateMeasurement;
  static constexpr std::string_view type = "tachless.state_measurement_t", suffix = "STATE";
  static constexpr auto fields = std::tuple{
      per_joint("position", "q", "rad", &Value::q, "link position"),
      per_joint("velocity", "v", "rad/s", &Value::v, "link velocity"),
      per_motor("motor_position", "theta", "rad", &Value::theta, "motor position"),
      per_motor("motor_velocity", "thetadot", "rad/s", &Value::thetadot, "motor velocity")};
};

/// Most characters of a law's gains in a message.
inline constexpr int max_gains_text = 4000;

/// A C4 reference at one instant, and the law's gains for it.
struct ReferencePoint {
  Vector q_ref;         ///< position [rad; m]
  Vector v_ref;         ///< velocity [rad/s; m/s]
  Vector a_ref;         ///< acceleration [rad/s^2; m/s^2]
  Vector jerk_ref;      ///< [rad/s^3; m/s^3]
  Vector snap_ref;      ///< [rad/s^4; m/s^4]
  std::string gains{};  ///< in the form of scenario::gains_text; empty: the scenario's

  using Value = ReferencePoint;
  static constexpr std::string_view type = "tachless.reference_t", suffix = "REFERENCE";
  static constexpr auto fields = std::tuple{
      per_joint("position", "q_ref", "rad", &Value::q_ref, "reference position"),
      per_joint("velocity", "v_ref", "rad/s", &Value::v_ref, "reference velocity"),
      per_joint("acceleration", "a_ref", "rad/s^2", &Value::a_ref, "reference acceleration"),
      per_joint("jerk", "jerk_ref", "rad/s^3", &Value::jerk_ref, "reference jerk"),
      per_joint("snap", "snap_ref", "rad/s^4", &Value::snap_ref, "reference snap"),
      text("gains", max_gains_text, &Value::gains)};
};

/// Torque of the motors; positive torque accelerates the joint.
struct TorqueCommand {
  Vector tau;  ///< [N m; N]

  static constexpr std::string_view type = "tachless.torque_command_t", suffix = "COMMAND";
  static constexpr auto fields =
      std::tuple{per_joint("torque", "tau", "N m", &TorqueCommand::tau,
                           "motor torque commanded from this tick's measurement")};
};

/// Name and unit of one signal that a law declares, for the log. The unit applies to a revolute
/// joint, in SI symbols ("rad", "rad/s", "N m"). The name contains neither ':' nor ','.
struct Signal {
  std::string_view name;  ///< name of the column
  std::string_view unit;  ///< unit of its values
};

/// Most signals that a law may declare.
inline constexpr int max_signals = 8;

/// Signals that a law computes beside its command, for the log. Entry i belongs to the i-th
/// declared signal and has one value per joint. Entries from `num` on are empty. The first signal
/// of every law is the position error, whose norm the controller announces. `Participant::signals`
/// and `RunInfo::signals` hold names and units of the rows.
struct LawSignals {
  int num = 0;                            ///< number of signals
  std::array<Vector, max_signals> value;  ///< one per signal

  static constexpr std::string_view type = "tachless.controller_state_t",
                                    suffix = "CONTROLLER_STATE";
  static constexpr auto fields = std::tuple{Field<LawSignals, std::array<Vector, max_signals>>{
      "value", "value", "", Kind::real, Count::signals, &LawSignals::value}};
};

/// Returns declared signals as the text "error:rad,nu:rad/s" of participant_t and run_info_t.
std::string text_of(std::span<const Signal> signals);

/// Returns the signals of a text of `text_of`, as views into `text`. Returns nullopt for another
/// text or for more than `max_signals` signals. An empty text declares none.
std::optional<std::vector<Signal>> parse_signals(std::string_view text);
/// Returns whether `parse_signals` reads this text; allocates no memory.
[[nodiscard]] bool are_signals(std::string_view text);

}  // namespace tachless::messages
