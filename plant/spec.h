#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "plant/load_spec.h"
#include "robot/quantities.h"
#include "schema/schema.h"

/// What a scenario says about the plant (the models: docs/plant.md), each value declared once with
/// its key. Values only: no mechanics and no reading.
namespace tachless::plant {

/// Longest command delay and encoder latency [ticks].
inline constexpr int max_delay_ticks = 16;

/// Motors fixed to their joints.
struct RigidJoints {
  robot::Vector rotor_inertia;  ///< [kg m2], on the link side of the gear

  static constexpr std::string_view name = "rigid";
  static constexpr std::tuple keys{
      schema::Key{"rotor_inertia_kgm2", &RigidJoints::rotor_inertia, "kg m²",
                  "Added to the diagonal of M, on the link side of the gear"}
          .in(schema::not_negative)
          .by_default(0)};
};

/// Motors behind springs: Spong's simplified model (paper, eq. 1).
struct FlexibleDrive {
  robot::Vector stiffness;      ///< K [N m/rad]
  robot::Vector rotor_inertia;  ///< J [kg m2], on the link side of the gear
  robot::Vector motor_damping;  ///< [N m s/rad]
  robot::Vector motor_coulomb_friction_Nm;

  static constexpr std::string_view name = "flexible";
  static constexpr std::tuple keys{
      schema::Key{"stiffness_Nm_per_rad", &FlexibleDrive::stiffness, "N m/rad",
                  "Spring between motor and link"}
          .in(schema::positive),
      schema::Key{"rotor_inertia_kgm2", &FlexibleDrive::rotor_inertia, "kg m²",
                  "Rotor J, on the link side of the gear"}
          .in(schema::positive),
      schema::Key{"motor_damping_Nms_per_rad", &FlexibleDrive::motor_damping, "N m s/rad",
                  "Viscous damping of the motor"}
          .in(schema::not_negative)
          .by_default(0),
      schema::Key{"motor_coulomb_friction_Nm", &FlexibleDrive::motor_coulomb_friction_Nm, "N m",
                  "Against the motion of the motor; holds one at rest"}
          .in(schema::not_negative)
          .by_default(0)};
};

/// The drives' torque until the first command acts.
enum class InitialTorque {
  zero,
  hold,  ///< what holds the initial posture: a real arm opens its brakes under torque
};
constexpr std::array<std::string_view, 2> names(InitialTorque /*type*/) { return {"zero", "hold"}; }

struct InitialState {
  robot::Vector position_rad;
  robot::Vector velocity_rad_per_s;
  std::optional<robot::Vector> motor_position_rad;        ///< nothing: static balance
  std::optional<robot::Vector> motor_velocity_rad_per_s;  ///< nothing: at rest
  InitialTorque torque = InitialTorque::zero;
  robot::Vector torque_Nm;  ///< no key: in place of `torque`; empty: none

  static constexpr std::tuple keys{
      schema::Key{"position_rad", &InitialState::position_rad, "rad (m)",
                  "Link position, within the URDF's limits"}
          .by_default(0),
      schema::Key{"velocity_rad_per_s", &InitialState::velocity_rad_per_s, "rad/s (m/s)",
                  "Link velocity"}
          .by_default(0),
      schema::Key{"motor_position_rad", &InitialState::motor_position_rad, "rad",
                  "Motor position, flexible joints only"}
          .by_default("static balance"),
      schema::Key{"motor_velocity_rad_per_s", &InitialState::motor_velocity_rad_per_s, "rad/s",
                  "Motor velocity, flexible joints only"}
          .by_default("at rest"),
      schema::Key{"torque", &InitialState::torque, "",
                  "Of the drives until the first command acts (`loop.command_delay`): none, or "
                  "what holds the robot at rest in its initial posture"}
          .by_default("zero; hold with a real robot")};
};

/// What computes the links' inertia matrix and bias.
enum class Mechanics {
  simbody,  ///< the reference
  native,   ///< robot/'s recursions; allocates nothing
};
constexpr std::array<std::string_view, 2> names(Mechanics /*type*/) {
  return {"simbody", "native"};
}

struct IntegratorSpec {
  double accuracy = 1e-9;

  static constexpr std::tuple keys{
      schema::Key{"accuracy", &IntegratorSpec::accuracy, "",
                  "Relative accuracy of one step of Merson's Runge-Kutta method"}
          .in({1e-14, 1e-1})
          .by_default()};
};

/// Where a flexible robot has encoders.
enum class EncoderSide { link, motor, both };
constexpr std::array<std::string_view, 3> names(EncoderSide /*type*/) {
  return {"link", "motor", "both"};
}

struct EncoderSpec {
  std::optional<robot::Vector> resolution_bits;  ///< counts per revolution = 2^bits; nothing: ideal
  int latency_ticks = 0;
  double noise_std_rad = 0;
  double velocity_noise_std_rad_per_s = 0;
  std::uint64_t seed = 1;
  EncoderSide side = EncoderSide::both;
  robot::Vector eccentricity_rad, eccentricity_phase_rad;  ///< empty: none

  static constexpr std::tuple keys{
      schema::Key{"resolution_bits", &EncoderSpec::resolution_bits, "bit",
                  "2^bits counts per revolution, on a prismatic joint over its range in the URDF; "
                  "null = ideal"}
          .in({1, 52, false, false, true})
          .by_default("`null`")
          .or_null(),
      schema::Key{"latency_ticks", &EncoderSpec::latency_ticks, "ticks",
                  "Age of the state that is measured; before tick 0 it is the initial one"}
          .in({0, max_delay_ticks})
          .by_default(),
      schema::Key{"noise_std_rad", &EncoderSpec::noise_std_rad, "rad (m)",
                  "Gaussian noise on positions, before quantisation"}
          .in(schema::not_negative)
          .by_default(),
      schema::Key{"velocity_noise_std_rad_per_s", &EncoderSpec::velocity_noise_std_rad_per_s,
                  "rad/s (m/s)", "Gaussian noise on velocities, for the laws that measure them"}
          .in(schema::not_negative)
          .by_default(),
      schema::Key{"seed", &EncoderSpec::seed, "", "Of the noise: the same seed gives the same run"}
          .in({0, 9007199254740992.0})
          .by_default(),
      schema::Key{"side", &EncoderSpec::side, "",
                  "Where encoders are; `motor` needs flexible joints"}
          .by_default(),
      schema::Key{"eccentricity_rad", &EncoderSpec::eccentricity_rad, "rad",
                  "a of q + a sin(q + phase), which encoders of links that turn read"}
          .in({0, 1, false, true})
          .by_default(0),
      schema::Key{"eccentricity_phase_rad", &EncoderSpec::eccentricity_phase_rad, "rad",
                  "Of the eccentricity"}
          .by_default(0)};
};

struct DriveSpec {
  std::optional<robot::Vector> torque_limit_Nm;             ///< nothing: no limit
  std::optional<robot::Vector> torque_rate_limit_Nm_per_s;  ///< nothing: no limit
  robot::Vector viscous_friction_Nms_per_rad;
  robot::Vector coulomb_friction_Nm;
  std::optional<robot::Vector> static_friction_Nm;  ///< nothing: Coulomb's
  robot::Vector stribeck_velocity_rad_per_s;
  std::optional<robot::Vector> current_loop_hz;  ///< nothing: the torque acts at once
  robot::Vector torque_scale, torque_offset_Nm;  ///< empty: 1 and 0
  int command_age_jitter_ticks = 0;
  std::uint64_t seed = 1;
  double delay_fraction = 0;  ///< no key: of a tick, on top of loop.command_delay, in [0, 1)

  /// Whether any joint has friction that can hold it.
  [[nodiscard]] bool dry_friction() const {
    return (coulomb_friction_Nm.array() > 0).any() ||
           (static_friction_Nm && (static_friction_Nm->array() > 0).any());
  }

  static constexpr std::tuple keys{
      schema::Key{"torque_limit_Nm", &DriveSpec::torque_limit_Nm, "N m (N)",
                  "Largest torque of the drive; null = none"}
          .in(schema::positive)
          .by_default("effort limits of the URDF")
          .or_null(),
      schema::Key{"viscous_friction_Nms_per_rad", &DriveSpec::viscous_friction_Nms_per_rad,
                  "N m s/rad", "On the links' joints"}
          .in(schema::not_negative)
          .by_default("`<dynamics damping>` of the URDF"),
      schema::Key{"torque_rate_limit_Nm_per_s", &DriveSpec::torque_rate_limit_Nm_per_s,
                  "N m/s (N/s)", "Fastest change of the drive's torque; null = none"}
          .in(schema::positive)
          .by_default("none")
          .or_null(),
      schema::Key{"coulomb_friction_Nm", &DriveSpec::coulomb_friction_Nm, "N m (N)",
                  "Against the motion of a link's joint; holds one at rest"}
          .in(schema::not_negative)
          .by_default("`<dynamics friction>` of the URDF"),
      schema::Key{"static_friction_Nm", &DriveSpec::static_friction_Nm, "N m (N)",
                  "Torque from which on a joint at rest begins to move, at least Coulomb's"}
          .in(schema::not_negative)
          .by_default("Coulomb's"),
      schema::Key{"stribeck_velocity_rad_per_s", &DriveSpec::stribeck_velocity_rad_per_s,
                  "rad/s (m/s)",
                  "Speed v_s of the fall from static to Coulomb's friction: exp(-(v/v_s)²)"}
          .in(schema::positive)
          .by_default(0.01),
      schema::Key{"current_loop_hz", &DriveSpec::current_loop_hz, "Hz",
                  "Bandwidth of the torque's first-order lag 1/(2π bandwidth); null = none"}
          .in(schema::positive)
          .by_default("`null`")
          .or_null(),
      schema::Key{"torque_scale", &DriveSpec::torque_scale, "",
                  "Torque that acts over that asked for: an error of the torque constant"}
          .in(schema::positive)
          .by_default(1),
      schema::Key{"torque_offset_Nm", &DriveSpec::torque_offset_Nm, "N m (N)",
                  "Acts on top, whatever is commanded"}
          .by_default(0),
      schema::Key{"command_age_jitter_ticks", &DriveSpec::command_age_jitter_ticks, "ticks",
                  "Age beyond `loop.command_delay`, drawn for each tick from 0 to this"}
          .in({0, max_delay_ticks})
          .by_default(),
      schema::Key{"seed", &DriveSpec::seed, "", "Of that age: the same seed gives the same run"}
          .in({0, 9007199254740992.0})
          .by_default()};
};

/// What the emulator does when a link leaves the URDF's range or exceeds the URDF's velocity.
enum class OnLimit {
  stop,  ///< the protective stop, as a real robot's driver does
  warn   ///< says so once per joint, and counts
};
constexpr std::array<std::string_view, 2> names(OnLimit /*type*/) { return {"stop", "warn"}; }

/// The scenario's `plant` map.
struct Spec {
  InitialState initial;
  Mechanics mechanics = Mechanics::simbody;
  IntegratorSpec integrator;
  EncoderSpec encoder;
  DriveSpec drive;
  PayloadSpec payload;
  std::vector<DisturbanceSpec> disturbances;
  OnLimit on_limit = OnLimit::stop;
  std::optional<robot::Vector> following_error_rad;
  bool dry_run = false;
  int withheld_ticks = 0;

  static constexpr std::tuple keys{
      schema::Key{"initial", &Spec::initial},
      schema::Key{"mechanics", &Spec::mechanics, "",
                  "What computes the robot's mechanics: Simbody, or this program's own recursions, "
                  "which are some ten times as fast"}
          .by_default(),
      schema::Key{"integrator", &Spec::integrator},
      schema::Key{"encoder", &Spec::encoder},
      schema::Key{"drive", &Spec::drive},
      schema::Key{"payload", &Spec::payload},
      schema::Key{"disturbances", &Spec::disturbances, "",
                  "Torques on joints and forces on links that no drive gives; each has `joint` and "
                  "`torque_Nm`, or `link` and `force_N`"}
          .by_default("none"),
      schema::Key{"on_limit", &Spec::on_limit, "",
                  "When a joint leaves the URDF's range or exceeds its velocity: `stop` ends the "
                  "run with exit code 5, `warn` says so once per joint and counts the ticks"}
          .by_default(),
      schema::Key{"following_error_rad", &Spec::following_error_rad, "rad (m)",
                  "The protective stop when a joint is further from its reference than at the "
                  "start by more than this"}
          .in(schema::positive)
          .by_default("0.05 with a real robot, none with the emulator"),
      schema::Key{"dry_run", &Spec::dry_run, "",
                  "A real robot is read and sent nothing, its drives are not enabled; everything "
                  "else is as in a run"}
          .by_default(),
      schema::Key{"withheld_ticks", &Spec::withheld_ticks, "ticks",
                  "A real robot is sent nothing in so many ticks in a row, the last of each ten "
                  "times as many; what it does then is for `commission` to see"}
          .in({0, 1000})
          .by_default()};
};

/// Whether a real robot is sent nothing in `tick`.
inline bool withheld(const Spec& plant, std::int64_t tick) {
  const std::int64_t ticks = plant.withheld_ticks;
  return ticks > 0 && tick % (10 * ticks) >= 9 * ticks;
}

}  // namespace tachless::plant
