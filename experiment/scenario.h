#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "diagnostics/failure.h"
#include "robot/quantities.h"

/// One experiment = one YAML file. Every key has its unit in its name and a documented default;
/// unknown keys and values out of range are errors that name file, line, key, value and the
/// allowed range.
namespace tachless::experiment {

struct FlexibleJoints {
  robot::Vector stiffness_Nm_per_rad;
  robot::Vector rotor_inertia_kgm2;
  robot::Vector motor_damping_Nms_per_rad;  ///< default 0
};

struct RobotSpec {
  std::string name = "arm";
  std::string channel_prefix = "ARM";  ///< name in upper case
  std::string urdf_path;               ///< as written in the scenario
  std::string urdf_text;
  double gravity_m_per_s2 = 9.81;  ///< along -z of the URDF's root link
  std::optional<FlexibleJoints> flexible;
  robot::Vector rigid_rotor_inertia_kgm2;  ///< joints: {rigid: {rotor_inertia_kgm2}}; default 0
};

struct InitialState {
  robot::Vector position_rad;                             ///< default 0
  robot::Vector velocity_rad_per_s;                       ///< default 0
  std::optional<robot::Vector> motor_position_rad;        ///< default: static balance
  std::optional<robot::Vector> motor_velocity_rad_per_s;  ///< default: at rest
};

enum class IntegratorMethod {
  runge_kutta_merson,
  runge_kutta_3,
  runge_kutta_feldberg,
  semi_explicit_euler_2,
  verlet,
  cpodes
};

struct IntegratorSpec {
  IntegratorMethod method = IntegratorMethod::runge_kutta_merson;
  double accuracy = 1e-9;
};

enum class EncoderSide { link, motor, both };

struct EncoderSpec {
  std::optional<int> resolution_bits;  ///< counts per revolution = 2^bits; null = ideal
  double noise_std_rad = 0;
  double velocity_noise_std_rad_per_s = 0;
  std::uint64_t seed = 1;
  EncoderSide side = EncoderSide::both;  ///< which encoders the robot has
};

struct DriveSpec {
  std::optional<robot::Vector>
      torque_limit_Nm;                         ///< default: effort limits of the URDF; null = none
  robot::Vector viscous_friction_Nms_per_rad;  ///< default 0
};

struct PayloadSpec {
  double mass_kg = 0;  ///< known to the plant, not to the controller
  std::string link;    ///< default: the leaf link that is farthest from the root
};

struct PlantSpec {
  InitialState initial;
  IntegratorSpec integrator;
  EncoderSpec encoder;
  DriveSpec drive;
  PayloadSpec payload;
};

struct Hold {
  robot::Vector position_rad;
};
/// q_i(t) = offset_i + amplitude_i sin(2 pi frequency_i t + phase_i)
struct Sinusoid {
  robot::Vector amplitude_rad, frequency_hz, phase_rad, offset_rad;
};
/// q_i(t) = offset_i + sum over terms of sinusoids
struct MultiSine {
  robot::Vector offset_rad;
  std::vector<Sinusoid> terms;
};
/// Degree-9 polynomial, at rest through snap at both ends; before `start_s` at `from`, after
/// start_s + duration_s at `to`.
struct PointToPoint {
  robot::Vector from_rad, to_rad;
  double start_s = 0, duration_s = 1;
};
/// C4 spline through (time, position), at rest at both ends.
struct Waypoints {
  std::vector<double> time_s;
  std::vector<robot::Vector> position_rad;
};
using ReferenceSpec = std::variant<Hold, Sinusoid, MultiSine, PointToPoint, Waypoints>;

enum class FilterKind { first_order_hold, tustin, backward_euler, zero_order_hold };
enum class FilterStart { at_error, zero };  ///< w(0) = e(0), hence nu(0) = 0; or w(0) = 0
enum class FeedforwardLead { none, half_tick_plus_delay };

struct ControllerSpec {
  std::string law;
  std::map<std::string, robot::Vector> gains;  ///< each of length num_joints
  FilterKind filter = FilterKind::first_order_hold;
  FilterStart filter_start = FilterStart::at_error;
  FeedforwardLead feedforward_lead = FeedforwardLead::none;
};

enum class Mode { lockstep, realtime };

struct LoopSpec {
  Mode mode = Mode::lockstep;
  double period_s = 1e-3;
  double duration_s = 1;
  std::int64_t num_ticks = 1000;  ///< duration / period, an integer
  int command_delay = 0;          ///< default 0 in lockstep, 1 in realtime
  int max_missed = 20;            ///< realtime: commands missed in a row before the protective stop
  double give_up_s = 5;
};

struct Scenario {
  std::string name;
  RobotSpec robot;
  PlantSpec plant;
  ReferenceSpec reference;
  ControllerSpec controller;
  LoopSpec loop;

  int num_joints = 0;
  std::string text;         ///< YAML with `--set` applied: parse(text, urdf_text) gives this again
  std::int64_t digest = 0;  ///< of text and URDF
  std::string source;       ///< file name for messages
  std::map<std::string, int> line;            ///< "controller.gains.kp" -> line in the source
  std::map<std::string, std::string> set_by;  ///< key -> the --set that gave its value

  /// A Failure(bad_usage) that reads "<file>:<line>: <key>: <problem>", or, when the value came
  /// from the command line, "--set <key=value>: <key>: <problem>".
  [[nodiscard]] diagnostics::Failure complaint(const std::string& key,
                                               const std::string& problem) const;
};

/// Reads `path` and the URDF it names (relative to the scenario's file). `overrides` are
/// "key.path=value" as given to --set; a value is YAML.
/// @throw Failure(bad_usage), one line: file, line, key, value, allowed range, nearest known key.
Scenario load_scenario(const std::filesystem::path& path,
                       const std::vector<std::string>& overrides = {});

/// The same from texts, as a log holds them. `source` stands in for the file name.
Scenario parse_scenario(std::string_view text, std::string_view urdf_text,
                        const std::string& source, const std::vector<std::string>& overrides = {});

}  // namespace tachless::experiment
