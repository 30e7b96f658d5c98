#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/quantities.h"
#include "base/schema.h"
#include "robot/joint_friction.h"

/// Values of a scenario for the plant, whose models docs/plant.md describes. Each value is declared
/// once, with its key. The header has no mechanics and reads no file.
namespace tachless::plant {

/// Longest command delay and encoder latency [ticks].
inline constexpr int max_delay_ticks = 16;

/// Motors fixed to their joints.
struct RigidJoints {
  Vector rotor_inertia;  ///< [kg m2], on the link side of the gear

  static constexpr std::string_view name = "rigid";
  static constexpr std::tuple keys{
      base::Key{"rotor_inertia_kgm2", &RigidJoints::rotor_inertia, "kg m²",
                "Added to the diagonal of M, on the link side of the gear"}
          .in(base::not_negative)
          .by_default(0)};
};

/// Motors behind springs: Spong's simplified model (paper, eq. 1).
struct FlexibleDrive {
  Vector stiffness;      ///< K [N m/rad]
  Vector rotor_inertia;  ///< J [kg m2], on the link side of the gear
  Vector motor_damping;  ///< [N m s/rad]
  Vector motor_coulomb_friction_Nm;
  Vector spring_damping{};  ///< D_s [N m s/rad]; empty: none

  static constexpr std::string_view name = "flexible";
  static constexpr std::tuple keys{
      base::Key{"stiffness_Nm_per_rad", &FlexibleDrive::stiffness, "N m/rad",
                "Spring between motor and link"}
          .in(base::positive),
      base::Key{"rotor_inertia_kgm2", &FlexibleDrive::rotor_inertia, "kg m²",
                "Rotor J, on the link side of the gear"}
          .in(base::positive),
      base::Key{"motor_damping_Nms_per_rad", &FlexibleDrive::motor_damping, "N m s/rad",
                "Viscous damping of the motor"}
          .in(base::not_negative)
          .by_default(0),
      base::Key{"motor_coulomb_friction_Nm", &FlexibleDrive::motor_coulomb_friction_Nm, "N m",
                "Against the motion of the motor; holds one at rest"}
          .in(base::not_negative)
          .by_default(0),
      base::Key{"spring_damping_Nms_per_rad", &FlexibleDrive::spring_damping, "N m s/rad",
                "Viscous damping parallel to the spring, as gears have it; the laws do not know "
                "of it"}
          .in(base::not_negative)
          .by_default(0)};
};

/// The drives' torque until the first command acts.
enum class InitialTorque {
  zero,
  hold,  ///< torque that holds the initial posture, as a real arm gives when it opens its brakes
};
constexpr std::array<std::string_view, 2> names(InitialTorque /*type*/) { return {"zero", "hold"}; }

/// State of the plant before tick 0.
struct InitialState {
  Vector position_rad;
  Vector velocity_rad_per_s;
  std::optional<Vector> motor_position_rad;        ///< nothing: static balance
  std::optional<Vector> motor_velocity_rad_per_s;  ///< nothing: at rest
  InitialTorque torque = InitialTorque::zero;
  Vector torque_Nm;  ///< has no key; replaces `torque`; empty: none

  static constexpr std::tuple keys{
      base::Key{"position_rad", &InitialState::position_rad, "rad (m)",
                "Link position, within the URDF's limits"}
          .by_default(0),
      base::Key{"velocity_rad_per_s", &InitialState::velocity_rad_per_s, "rad/s (m/s)",
                "Link velocity"}
          .by_default(0),
      base::Key{"motor_position_rad", &InitialState::motor_position_rad, "rad",
                "Motor position, flexible joints only"}
          .by_default("static balance"),
      base::Key{"motor_velocity_rad_per_s", &InitialState::motor_velocity_rad_per_s, "rad/s",
                "Motor velocity, flexible joints only"}
          .by_default("at rest"),
      base::Key{
          "torque", &InitialState::torque, "",
          "Torque of the drives until the first command acts (`loop.command_delay`): none, or "
          "what holds the robot at rest in its initial posture"}
          .by_default("zero; hold with a real robot")};
};

/// Program part that computes the links' inertia matrix and bias.
enum class Mechanics {
  simbody,  ///< Simbody; `native` is tested against it
  native,   ///< robot/'s recursions; allocates nothing
};
constexpr std::array<std::string_view, 2> names(Mechanics /*type*/) {
  return {"simbody", "native"};
}

struct IntegratorSpec {
  double accuracy = 1e-9;

  static constexpr std::tuple keys{
      base::Key{"accuracy", &IntegratorSpec::accuracy, "",
                "Relative accuracy of one step of Merson's Runge-Kutta method"}
          .in({1e-14, 1e-1})
          .by_default()};
};

/// Integrator of a MuJoCo model.
enum class MujocoIntegrator { model, euler, implicit, rk4 };
constexpr std::array<std::string_view, 4> names(MujocoIntegrator /*type*/) {
  return {"model", "euler", "implicit", "rk4"};
}

/// MuJoCo in place of the emulator's mechanics.
struct MujocoSpec {
  std::string model;     ///< path as written; empty: the emulator's own mechanics
  std::string keyframe;  ///< empty: the model's initial state
  MujocoIntegrator integrator = MujocoIntegrator::model;
  double step_s = 0;  ///< 0: the model's
  bool may_differ = false;

  static constexpr std::tuple keys{
      base::Key{"model", &MujocoSpec::model, "",
                "MuJoCo model (MJCF or URDF) whose mechanics move the robot, contacts included; "
                "absolute or relative to the scenario's file. Needs the module mujoco.so"}
          .by_default("none"),
      base::Key{"keyframe", &MujocoSpec::keyframe, "",
                "Keyframe that everything but the scenario's joints begins in"}
          .by_default("the model's initial state"),
      base::Key{"integrator", &MujocoSpec::integrator, "",
                "MuJoCo's integrator; `model`: the one that the model names"}
          .by_default(),
      base::Key{"step_s", &MujocoSpec::step_s, "s",
                "Longest step; steps of equal length fill each tick"}
          .in(base::positive)
          .by_default("the model's timestep"),
      base::Key{"may_differ", &MujocoSpec::may_differ, "",
                "Go on where the inertia matrix or gravity torque of the model is not that of "
                "`robot.urdf`: the law's robot is then not the plant's"}
          .by_default()};
};

/// Side of the springs on which a flexible robot has encoders.
enum class EncoderSide { link, motor, both };
constexpr std::array<std::string_view, 3> names(EncoderSide /*type*/) {
  return {"link", "motor", "both"};
}

struct EncoderSpec {
  std::optional<Vector> resolution_bits;  ///< counts per revolution = 2^bits; nothing: ideal
  int latency_ticks = 0;
  double noise_std_rad = 0;
  double velocity_noise_std_rad_per_s = 0;
  std::uint64_t seed = 1;
  EncoderSide side = EncoderSide::both;
  Vector eccentricity_rad, eccentricity_phase_rad;  ///< empty: none

  static constexpr std::tuple keys{
      base::Key{"resolution_bits", &EncoderSpec::resolution_bits, "bit",
                "2^bits counts per revolution, on a prismatic joint over its range in the URDF; "
                "null = ideal"}
          .in(base::whole(1, 52))
          .by_default("`null`")
          .or_null(),
      base::Key{"latency_ticks", &EncoderSpec::latency_ticks, "ticks",
                "Age of the state that is measured; before tick 0 it is the initial one"}
          .in({0, max_delay_ticks})
          .by_default(),
      base::Key{"noise_std_rad", &EncoderSpec::noise_std_rad, "rad (m)",
                "Gaussian noise on positions, before quantisation"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"velocity_noise_std_rad_per_s", &EncoderSpec::velocity_noise_std_rad_per_s,
                "rad/s (m/s)", "Gaussian noise on velocities, for the laws that measure them"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"seed", &EncoderSpec::seed, "",
                "Seed of the noise: the same seed gives the same run"}
          .in({0, 9007199254740992.0})
          .by_default(),
      base::Key{"side", &EncoderSpec::side, "",
                "Side of the encoders; `motor` needs flexible joints"}
          .by_default(),
      base::Key{"eccentricity_rad", &EncoderSpec::eccentricity_rad, "rad",
                "a of q + a sin(q + phase), which encoders of links that turn read"}
          .in({0, 1, false, true})
          .by_default(0),
      base::Key{"eccentricity_phase_rad", &EncoderSpec::eccentricity_phase_rad, "rad",
                "Phase of the eccentricity"}
          .by_default(0)};
};

struct DriveSpec {
  std::optional<Vector> torque_limit_Nm;             ///< nothing: no limit
  std::optional<Vector> torque_rate_limit_Nm_per_s;  ///< nothing: no limit
  Vector viscous_friction_Nms_per_rad;
  Vector coulomb_friction_Nm;
  std::optional<Vector> static_friction_Nm;  ///< nothing: Coulomb's
  Vector stribeck_velocity_rad_per_s;
  Vector friction_rise_Nm, friction_rise_velocity_rad_per_s, load_friction;  ///< empty: none
  std::optional<Vector> current_loop_hz;  ///< nothing: the torque acts at once
  Vector torque_scale, torque_offset_Nm;  ///< empty: 1 and 0
  int command_age_jitter_ticks = 0;
  std::uint64_t seed = 1;
  double delay_fraction = 0;  ///< has no key; ticks in [0, 1) added to loop.command_delay

  /// Returns true if any joint has friction that is not viscous.
  [[nodiscard]] bool dry_friction() const {
    return (coulomb_friction_Nm.array() > 0).any() ||
           (static_friction_Nm && (static_friction_Nm->array() > 0).any()) ||
           !friction_rise_Nm.isZero(0) || !load_friction.isZero(0);
  }
  /// Returns the dry friction of a joint.
  [[nodiscard]] robot::JointFriction friction_of(Eigen::Index joint) const {
    const auto value = [&](const Vector& of, double none) {
      return of.size() == 0 ? none : of[joint];
    };
    const Vector& held = static_friction_Nm ? *static_friction_Nm : coulomb_friction_Nm;
    return {coulomb_friction_Nm[joint],
            held[joint],
            stribeck_velocity_rad_per_s[joint],
            value(friction_rise_Nm, 0),
            value(friction_rise_velocity_rad_per_s, 1),
            value(load_friction, 0)};
  }

  static constexpr std::tuple keys{
      base::Key{"torque_limit_Nm", &DriveSpec::torque_limit_Nm, "N m (N)",
                "Largest torque of the drive; null = none"}
          .in(base::positive)
          .by_default("effort limits of the URDF")
          .or_null(),
      base::Key{"viscous_friction_Nms_per_rad", &DriveSpec::viscous_friction_Nms_per_rad,
                "N m s/rad", "On the links' joints"}
          .in(base::not_negative)
          .by_default("`<dynamics damping>` of the URDF"),
      base::Key{"torque_rate_limit_Nm_per_s", &DriveSpec::torque_rate_limit_Nm_per_s, "N m/s (N/s)",
                "Fastest change of the drive's torque; null = none"}
          .in(base::positive)
          .by_default("none")
          .or_null(),
      base::Key{"coulomb_friction_Nm", &DriveSpec::coulomb_friction_Nm, "N m (N)",
                "Against the motion of a link's joint; holds one at rest"}
          .in(base::not_negative)
          .by_default("`<dynamics friction>` of the URDF"),
      base::Key{"static_friction_Nm", &DriveSpec::static_friction_Nm, "N m (N)",
                "Torque from which on a joint at rest begins to move, at least Coulomb's"}
          .in(base::not_negative)
          .by_default("Coulomb's"),
      base::Key{"stribeck_velocity_rad_per_s", &DriveSpec::stribeck_velocity_rad_per_s,
                "rad/s (m/s)",
                "Speed v_s of the fall from static to Coulomb's friction: exp(-(v/v_s)²)"}
          .in(base::positive)
          .by_default(0.01),
      base::Key{"friction_rise_Nm", &DriveSpec::friction_rise_Nm, "N m (N)",
                "F_r of F_r tanh(v/v_r), which Coulomb's friction grows by with speed; negative: "
                "it falls, by no more than Coulomb's"}
          .by_default(0),
      base::Key{"friction_rise_velocity_rad_per_s", &DriveSpec::friction_rise_velocity_rad_per_s,
                "rad/s (m/s)", "v_r of F_r tanh(v/v_r)"}
          .in(base::positive)
          .by_default(0.1),
      base::Key{"load_friction", &DriveSpec::load_friction, "",
                "Friction over gravity's torque at the joint, on top of Coulomb's, which is above "
                "zero there"}
          .in({0, 1})
          .by_default(0),
      base::Key{"current_loop_hz", &DriveSpec::current_loop_hz, "Hz",
                "Bandwidth of the torque's first-order lag 1/(2π bandwidth); null = none"}
          .in(base::positive)
          .by_default("`null`")
          .or_null(),
      base::Key{"torque_scale", &DriveSpec::torque_scale, "",
                "Torque that acts over that asked for: an error of the torque constant"}
          .in(base::positive)
          .by_default(1),
      base::Key{"torque_offset_Nm", &DriveSpec::torque_offset_Nm, "N m (N)",
                "Acts on top, whatever is commanded"}
          .by_default(0),
      base::Key{"command_age_jitter_ticks", &DriveSpec::command_age_jitter_ticks, "ticks",
                "Age beyond `loop.command_delay`, drawn for each tick from 0 to this"}
          .in({0, max_delay_ticks})
          .by_default(),
      base::Key{"seed", &DriveSpec::seed, "", "Seed of that age: the same seed gives the same run"}
          .in({0, 9007199254740992.0})
          .by_default()};
};

/// Returns the refusal of a list that does not have `size` numbers.
inline base::Refusal numbers_refusal(std::string_view key, const std::vector<double>& given,
                                     int size) {
  return {std::string(key),
          std::to_string(given.size()) + " numbers; allowed: " + std::to_string(size)};
}

struct PayloadSpec {
  double mass_kg = 0;  ///< known to the plant, not to the controller
  std::string link;    ///< empty: the leaf link that is farthest from the root
  std::vector<double> center_of_mass_m = {0, 0, 0};
  std::vector<double> inertia_kgm2 = {0, 0, 0, 0, 0, 0};

  static constexpr std::tuple keys{
      base::Key{"mass_kg", &PayloadSpec::mass_kg, "kg",
                "Mass that the plant has and the controller does not know of"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"link", &PayloadSpec::link, "", "URDF link that carries it"}.by_default(
          "the leaf link farthest from the root"),
      base::Key{"center_of_mass_m", &PayloadSpec::center_of_mass_m, "m",
                "Its centre of mass, in the link's frame"}
          .by_default("[0, 0, 0]"),
      base::Key{"inertia_kgm2", &PayloadSpec::inertia_kgm2, "kg m²",
                "ixx, ixy, ixz, iyy, iyz, izz about its centre of mass, in the link's axes"}
          .by_default("a point mass's")};

  [[nodiscard]] std::optional<base::Refusal> refusal() const {
    if (center_of_mass_m.size() != 3)
      return numbers_refusal("center_of_mass_m", center_of_mass_m, 3);
    if (inertia_kgm2.size() != 6) return numbers_refusal("inertia_kgm2", inertia_kgm2, 6);
    return {};
  }
};

enum class DisturbanceShape { constant, pulse, sinusoid };
constexpr std::array<std::string_view, 3> names(DisturbanceShape /*type*/) {
  return {"constant", "pulse", "sinusoid"};
}

/// A torque on a joint, or a force on a link, that no drive gives: its value times its shape.
struct DisturbanceSpec {
  std::string joint;                           ///< joint that the torque acts on; empty: a force
  std::string link;                            ///< link that the force acts on; empty: a torque
  std::optional<double> torque_Nm;             ///< torque on `joint` [N m; N]
  std::optional<std::vector<double>> force_N;  ///< force on `link`, in the world's axes [N]
  std::vector<double> point_m = {0, 0, 0};     ///< point where the force acts, in the link's frame
  DisturbanceShape shape = DisturbanceShape::constant;
  double start_s = 0;
  std::optional<double> end_s;  ///< nothing: it does not end
  double frequency_hz = 0;
  double phase_rad = 0;

  [[nodiscard]] std::optional<base::Refusal> refusal() const {
    if (joint.empty() == link.empty()) {
      return base::Refusal{
          "joint", joint.empty() ? "neither a joint nor a link is given; allowed: one of the two"
                                 : "and a link are given; allowed: one of the two"};
    }
    if (torque_Nm.has_value() == joint.empty()) {
      return base::Refusal{"torque_Nm", "a joint takes torque_Nm, a link force_N"};
    }
    if (force_N.has_value() == link.empty()) {
      return base::Refusal{"force_N", "a link takes force_N, a joint torque_Nm"};
    }
    if (force_N && force_N->size() != 3) return numbers_refusal("force_N", *force_N, 3);
    if (point_m.size() != 3) return numbers_refusal("point_m", point_m, 3);
    if (end_s ? *end_s <= start_s : shape == DisturbanceShape::pulse) {
      return base::Refusal{
          "end_s", end_s ? "not after start_s; allowed: later" : "missing; a pulse needs its end"};
    }
    if ((shape == DisturbanceShape::sinusoid) == (frequency_hz == 0)) {
      return base::Refusal{"frequency_hz", "a sinusoid has a frequency above 0, others have none"};
    }
    return {};
  }

  static constexpr std::tuple keys{
      base::Key{"joint", &DisturbanceSpec::joint, "", "Joint that a torque acts on"}.by_default(
          "none: a force"),
      base::Key{"link", &DisturbanceSpec::link, "", "URDF link that a force acts on"}.by_default(
          "none: a torque"),
      base::Key{"torque_Nm", &DisturbanceSpec::torque_Nm, "N m (N)", "On `joint`"}.by_default(
          "none"),
      base::Key{"force_N", &DisturbanceSpec::force_N, "N", "On `link`, [x, y, z] of the world"}
          .by_default("none"),
      base::Key{"point_m", &DisturbanceSpec::point_m, "m",
                "Point at which the force acts, in the link's frame"}
          .by_default("[0, 0, 0]"),
      base::Key{"shape", &DisturbanceSpec::shape, "",
                "Factor of the value from `start_s` to `end_s`: 1; half a sine wave "
                "from start to end; sin(2π frequency (t - start) + phase)"}
          .by_default(),
      base::Key{"start_s", &DisturbanceSpec::start_s, "s", "Nothing before"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"end_s", &DisturbanceSpec::end_s, "s", "Nothing from then on; a pulse needs it"}
          .in(base::positive)
          .by_default("never"),
      base::Key{"frequency_hz", &DisturbanceSpec::frequency_hz, "Hz", "Frequency of a sinusoid"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"phase_rad", &DisturbanceSpec::phase_rad, "rad", "Phase of a sinusoid"}
          .by_default()};
};

/// Reaction of the emulator to a joint beyond the URDF's range or velocity.
enum class OnLimit {
  stop,  ///< the protective stop, as a real robot's driver does
  warn   ///< one warning per joint; the ticks are counted
};
constexpr std::array<std::string_view, 2> names(OnLimit /*type*/) { return {"stop", "warn"}; }

/// The scenario's `plant` map.
struct Spec {
  InitialState initial;
  Mechanics mechanics = Mechanics::simbody;
  IntegratorSpec integrator;
  MujocoSpec mujoco;
  EncoderSpec encoder;
  DriveSpec drive;
  PayloadSpec payload;
  std::vector<DisturbanceSpec> disturbances;
  OnLimit on_limit = OnLimit::stop;
  std::optional<Vector> following_error_rad;
  std::optional<Vector> speed_limit_rad_per_s;
  bool dry_run = false;
  bool zero_torque = false;
  int withheld_ticks = 0;

  static constexpr std::tuple keys{
      base::Key{"initial", &Spec::initial},
      base::Key{"mechanics", &Spec::mechanics, "",
                "Code of the robot's mechanics: Simbody, or this program's own recursions, "
                "which are some ten times as fast"}
          .by_default(),
      base::Key{"integrator", &Spec::integrator},
      base::Key{"mujoco", &Spec::mujoco},
      base::Key{"encoder", &Spec::encoder},
      base::Key{"drive", &Spec::drive},
      base::Key{"payload", &Spec::payload},
      base::Key{"disturbances", &Spec::disturbances, "",
                "Torques on joints and forces on links that no drive gives; each has `joint` and "
                "`torque_Nm`, or `link` and `force_N`"}
          .by_default("none"),
      base::Key{"on_limit", &Spec::on_limit, "",
                "When a joint leaves the URDF's range or exceeds its velocity: `stop` ends the "
                "run with exit code 5, `warn` says so once per joint and counts the ticks"}
          .by_default(),
      base::Key{"following_error_rad", &Spec::following_error_rad, "rad (m)",
                "The protective stop when a joint is further from its reference than at the "
                "start by more than this"}
          .in(base::positive)
          .by_default("0.05 with a real robot, none with the emulator"),
      base::Key{"speed_limit_rad_per_s", &Spec::speed_limit_rad_per_s, "rad/s (m/s)",
                "A joint that is faster is beyond its limit, as one faster than the URDF's limit; "
                "the lower of the two holds"}
          .in(base::positive)
          .by_default("none"),
      base::Key{"dry_run", &Spec::dry_run, "",
                "A real robot is read and sent nothing, its drives are not enabled; everything "
                "else is as in a run"}
          .by_default(),
      base::Key{"zero_torque", &Spec::zero_torque, "",
                "A real robot that adds gravity is started and sent zero torques; everything else "
                "is as in a run"}
          .by_default(),
      base::Key{"withheld_ticks", &Spec::withheld_ticks, "ticks",
                "A real robot is sent nothing in so many ticks in a row, the last of each ten "
                "times as many; what it does then is for `commission` to see"}
          .in({0, 1000})
          .by_default()};
};

/// Returns the key with which a real robot is not sent the law's torques; empty: it is.
inline std::string_view key_without_torques(const Spec& plant) {
  if (plant.dry_run) return "plant.dry_run";
  if (plant.zero_torque) return "plant.zero_torque";
  return plant.withheld_ticks > 0 ? "plant.withheld_ticks" : "";
}

/// Returns true if a real robot is sent nothing in `tick`.
inline bool withheld(const Spec& plant, std::int64_t tick) {
  const std::int64_t ticks = plant.withheld_ticks;
  return ticks > 0 && tick % (10 * ticks) >= 9 * ticks;
}

}  // namespace tachless::plant
