#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "robot/quantities.h"
#include "schema/schema.h"

/// What a scenario says about the plant, each value declared once with its key. Values only: no
/// mechanics and no reading. C++17-clean: the Simbody translation unit includes it.
namespace tachless::plant {

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
          .by_default(0)};
};

struct InitialState {
  robot::Vector position_rad;
  robot::Vector velocity_rad_per_s;
  std::optional<robot::Vector> motor_position_rad;        ///< nothing: static balance
  std::optional<robot::Vector> motor_velocity_rad_per_s;  ///< nothing: at rest

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
          .by_default("at rest")};
};

/// Whose multibody code computes the links' inertia matrix and bias, and integrates.
enum class Mechanics {
  simbody,  ///< the reference
  native,   ///< robot/'s recursions with explicit Runge-Kutta methods; allocates nothing
};

/// Simbody's integrators; the native mechanics have the three Runge-Kutta methods.
enum class Integrator {
  runge_kutta_merson,
  runge_kutta_3,
  runge_kutta_feldberg,
  semi_explicit_euler_2,
  verlet,
  cpodes
};

struct IntegratorSpec {
  Integrator method = Integrator::runge_kutta_merson;
  double accuracy = 1e-9;

  static constexpr std::tuple keys{
      schema::Key{"method", &IntegratorSpec::method, "", "How the plant is integrated over a tick"}
          .by_default(),
      schema::Key{"accuracy", &IntegratorSpec::accuracy, "", "Relative accuracy of the integrator"}
          .in({1e-14, 1e-1})
          .by_default()};
};

/// Where a flexible robot has encoders.
enum class EncoderSide { link, motor, both };

struct EncoderSpec {
  std::optional<int> resolution_bits;  ///< counts per revolution = 2^bits; nothing: ideal
  double noise_std_rad = 0;
  double velocity_noise_std_rad_per_s = 0;
  std::uint64_t seed = 1;
  EncoderSide side = EncoderSide::both;

  static constexpr std::tuple keys{
      schema::Key{
          "resolution_bits", &EncoderSpec::resolution_bits, "bit",
          "2^bits counts per revolution, on a prismatic joint over its range in the URDF; null = "
          "ideal"}
          .in({1, 52})
          .by_default()
          .or_null(),
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
          .by_default()};
};

struct DriveSpec {
  std::optional<robot::Vector> torque_limit_Nm;  ///< nothing: no limit
  robot::Vector viscous_friction_Nms_per_rad;

  static constexpr std::tuple keys{
      schema::Key{"torque_limit_Nm", &DriveSpec::torque_limit_Nm, "N m (N)",
                  "Largest torque of the drive; null = none"}
          .in(schema::positive)
          .by_default("effort limits of the URDF")
          .or_null(),
      schema::Key{"viscous_friction_Nms_per_rad", &DriveSpec::viscous_friction_Nms_per_rad,
                  "N m s/rad", "On the links' joints; Coulomb's friction is not modelled"}
          .in(schema::not_negative)
          .by_default("`<dynamics damping>` of the URDF")};
};

struct PayloadSpec {
  double mass_kg = 0;  ///< known to the plant, not to the controller
  std::string link;    ///< empty: the leaf link that is farthest from the root

  static constexpr std::tuple keys{
      schema::Key{"mass_kg", &PayloadSpec::mass_kg, "kg",
                  "Point mass that the plant has and the controller does not know of"}
          .in(schema::not_negative)
          .by_default(),
      schema::Key{"link", &PayloadSpec::link, "", "URDF link that carries it, at its origin"}
          .by_default("the leaf link farthest from the root")};
};

/// What the emulator does when a link leaves the URDF's range or exceeds the URDF's velocity.
enum class OnLimit {
  stop,  ///< the protective stop, as a real robot's driver does
  warn   ///< says so once per joint, and counts
};

/// The scenario's `plant` map.
struct Spec {
  InitialState initial;
  Mechanics mechanics = Mechanics::simbody;
  IntegratorSpec integrator;
  EncoderSpec encoder;
  DriveSpec drive;
  PayloadSpec payload;
  OnLimit on_limit = OnLimit::stop;

  static constexpr std::tuple keys{
      schema::Key{"initial", &Spec::initial},
      schema::Key{
          "mechanics", &Spec::mechanics, "",
          "Whose multibody code moves the robot: Simbody's, or our own recursions, which are "
          "some ten times as fast"}
          .by_default(),
      schema::Key{"integrator", &Spec::integrator},
      schema::Key{"encoder", &Spec::encoder},
      schema::Key{"drive", &Spec::drive},
      schema::Key{"payload", &Spec::payload},
      schema::Key{"on_limit", &Spec::on_limit, "",
                  "When a joint leaves the URDF's range or exceeds its velocity: `stop` ends the "
                  "run with exit code 5, `warn` says so once per joint and counts the ticks"}
          .by_default()};

  [[nodiscard]] std::optional<schema::Refusal> refusal() const {
    const bool explicit_runge_kutta = integrator.method <= Integrator::runge_kutta_feldberg;
    if (mechanics == Mechanics::simbody || explicit_runge_kutta) return {};
    return schema::Refusal{
        "mechanics",
        "native; allowed with this plant.integrator.method: simbody. The native "
        "mechanics have runge_kutta_merson, runge_kutta_3, runge_kutta_feldberg"};
  }
};

}  // namespace tachless::plant

namespace tachless::schema {

template <>
inline constexpr std::array<Name<plant::Mechanics>, 2> names<plant::Mechanics>{
    {{plant::Mechanics::simbody, "simbody"}, {plant::Mechanics::native, "native"}}};

template <>
inline constexpr std::array<Name<plant::OnLimit>, 2> names<plant::OnLimit>{
    {{plant::OnLimit::stop, "stop"}, {plant::OnLimit::warn, "warn"}}};

template <>
inline constexpr std::array<Name<plant::Integrator>, 6> names<plant::Integrator>{
    {{plant::Integrator::runge_kutta_merson, "runge_kutta_merson"},
     {plant::Integrator::runge_kutta_3, "runge_kutta_3"},
     {plant::Integrator::runge_kutta_feldberg, "runge_kutta_feldberg"},
     {plant::Integrator::semi_explicit_euler_2, "semi_explicit_euler_2"},
     {plant::Integrator::verlet, "verlet"},
     {plant::Integrator::cpodes, "cpodes"}}};

template <>
inline constexpr std::array<Name<plant::EncoderSide>, 3> names<plant::EncoderSide>{
    {{plant::EncoderSide::link, "link"},
     {plant::EncoderSide::motor, "motor"},
     {plant::EncoderSide::both, "both"}}};

}  // namespace tachless::schema
