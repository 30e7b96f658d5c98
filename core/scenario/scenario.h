#pragma once

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "base/failure.h"
#include "base/quantities.h"
#include "base/schema.h"
#include "controller/spec.h"
#include "plant/spec.h"
#include "reference/spec.h"
#include "robot/mjcf.h"
#include "robot/model.h"

namespace tachless::messages {
struct LawInfo;
}

/// Scenario of one experiment: one YAML file, read into typed values. Each value is declared once,
/// beside the member that it fills. The reader, the check for unknown keys and the table of
/// docs/scenario.md use the declarations. This header does not know how plant, controller and
/// reference use them.
namespace tachless::scenario {

/// Pose at which the robot's root link is fixed.
struct BaseSpec {
  std::vector<double> rpy = {0, 0, 0};
  std::vector<double> xyz = {0, 0, 0};

  [[nodiscard]] std::optional<base::Refusal> refusal() const;

  static constexpr std::tuple keys{
      base::Key{"rpy", &BaseSpec::rpy, "rad",
                "Roll, pitch, yaw of the root link, which is fixed to the ground: "
                "`[3.141592653589793, 0, 0]` hangs the robot from the ceiling"}
          .by_default("[0, 0, 0]"),
      base::Key{"xyz", &BaseSpec::xyz, "m", "Position of the root link; moves no torque"}
          .by_default("[0, 0, 0]")};
};

/// Terms that the arm's own controller adds to the torque that it is sent.
struct CompensationSpec {
  bool gravity = false;
  bool coriolis = false;
  double friction = 0;           ///< share of the friction that is cancelled, 0 to 1
  std::vector<double> base_rpy;  ///< base of the arm's own model [rad]; empty: robot.base
  std::string urdf_path;         ///< file of the arm's own model, as written; empty: robot.urdf

  /// Returns true if the arm adds a torque of its own model.
  [[nodiscard]] bool adds_torque() const { return gravity || coriolis; }
  /// Returns e.g. "gravity and friction", or "nothing".
  [[nodiscard]] std::string text() const;
  [[nodiscard]] std::optional<base::Refusal> refusal() const;

  static constexpr std::tuple keys{
      base::Key{"gravity", &CompensationSpec::gravity, "",
                "The arm's own controller adds g(q) to the torque that it is sent: a real arm is "
                "sent the torque without it. Laws, logs and certificates have the whole torque"}
          .by_default(),
      base::Key{"coriolis", &CompensationSpec::coriolis, "",
                "The same for C(q, v) v, with the measured speed (a mean over 20 ms where the "
                "driver measures none)"}
          .by_default(),
      base::Key{"friction", &CompensationSpec::friction, "",
                "Share of the friction that the arm's own controller cancels: friction of `plant` "
                "and `controller` is less by that share"}
          .in({0, 1})
          .by_default(),
      base::Key{"base_rpy", &CompensationSpec::base_rpy, "rad",
                "Base in the arm's own model, where it is set otherwise than `robot.base.rpy`: "
                "`[0, 0, 0]` for an upright model of an arm on a wall"}
          .by_default("`robot.base.rpy`"),
      base::Key{"urdf", &CompensationSpec::urdf_path, "",
                "URDF of the arm's own model, where it is another one, such as one without the "
                "tool; with the joints of `robot.urdf`"}
          .by_default("`robot.urdf`")};
};

struct RobotSpec {
  std::string name = "arm";
  std::string channel_prefix = "ARM";  ///< name in upper case
  std::string urdf_path;               ///< as written in the scenario
  /// Text of `robot::urdf_mechanics` for the file, then for controller.urdf if there is one.
  std::string urdf_text;
  robot::CheckInertia check_inertia = robot::CheckInertia::refuse;
  std::map<std::string, std::string> xacro;  ///< arguments of a urdf_path that ends in .xacro
  std::map<std::string, double> locked;      ///< positions of locked joints by name [rad; m]
  BaseSpec base;
  double gravity_m_per_s2 = 9.81;
  std::string joint_parameters;  ///< as written in the scenario; a recorded one has the numbers
  CompensationSpec compensates;
  Vector joint_signs;        ///< +1 or -1: q = sign q_driver + offset, tau_driver = sign tau
  Vector joint_offsets_rad;  ///< [rad; m]
  std::optional<plant::FlexibleDrive> flexible;  ///< nothing: rigid joints
  Vector rigid_rotor_inertia_kgm2;               ///< rotor inertia of rigid joints

  using Joints = std::variant<plant::RigidJoints, plant::FlexibleDrive>;
  void set_joints(Joints given);
  [[nodiscard]] std::optional<base::Refusal> refusal() const;

  static constexpr base::Key urdf_key{
      "urdf", &RobotSpec::urdf_path, "",
      "URDF or MJCF (MuJoCo) file, absolute or relative to the scenario's "
      "file"};
  static constexpr base::Key xacro_key =
      base::Key{"xacro", &RobotSpec::xacro, "",
                "Argument of the program `xacro`, which makes a URDF of `robot.urdf` where that "
                "ends in `.xacro`"}
          .by_default("none");
  // Key for the check of the URDF's inertias.
  static constexpr base::Key check_inertia_key =
      base::Key{"check_inertia", &RobotSpec::check_inertia, "",
                "Moving bodies with an inertia that no body can have: `refuse` them, or `warn` "
                "and go on where the inertia matrix is positive definite all the same"}
          .by_default();
  static constexpr base::Key locked_key =
      base::Key{"locked", &RobotSpec::locked, "rad (m)",
                "Joint of the URDF that is fixed at this position and no joint of the robot any "
                "more; what mimics it is held with it"}
          .by_default("none");
  static constexpr base::Key base_key{"base", &RobotSpec::base};

  static constexpr std::tuple keys{
      base::Key{"name", &RobotSpec::name, "",
                "Prefix of the channels, in upper case: letters, digits, `_`, at most 32"}
          .by_default(),
      urdf_key,
      xacro_key,
      check_inertia_key,
      locked_key,
      base_key,
      base::Key{"gravity_m_per_s2", &RobotSpec::gravity_m_per_s2, "m/s²",
                "Along -z of the world; the URDF's root link is in it at `robot.base`"}
          .in({0, 1000})
          .by_default(),
      base::Key{"joint_parameters", &RobotSpec::joint_parameters, "",
                "File with rotor inertia and friction by joint: an MJCF (`armature`, `damping`, "
                "`frictionloss`), or a YAML map from names to `rotor_inertia_kgm2`, "
                "`viscous_friction_Nms_per_rad`, `coulomb_friction_Nm`; relative to the "
                "scenario's file. What the scenario itself says of them goes first"}
          .by_default("none"),
      base::Key{"compensates", &RobotSpec::compensates},
      base::Key{
          "joint_signs", &RobotSpec::joint_signs, "",
          "Sign of a real robot's joint: 1, or -1 where it turns against its axis in the URDF"}
          .in(base::whole(-1, 1))
          .by_default(1),
      base::Key{"joint_offsets_rad", &RobotSpec::joint_offsets_rad, "rad (m)",
                "Position in the URDF where a real robot's driver reads 0"}
          .by_default(0),
      base::Key{"joints", &RobotSpec::set_joints, "",
                "Motors fixed to their joints, or behind springs"}
          .by_default()};
};

enum class Mode { lockstep, realtime };
constexpr std::array<std::string_view, 2> names(Mode /*type*/) { return {"lockstep", "realtime"}; }

struct LoopSpec {
  Mode mode = Mode::lockstep;
  double period_s = 1e-3;
  double duration_s = 1;
  std::int64_t num_ticks = 1000;  ///< duration / period, an integer
  int command_delay = 1;
  int max_missed = 20;
  double max_missed_share = 0.01;
  double give_up_s = 5;

  [[nodiscard]] std::optional<base::Refusal> refusal() const;

  static constexpr std::tuple keys{
      base::Key{"mode", &LoopSpec::mode, "",
                "Simulation time as fast as it goes, or wall-clock time"}
          .by_default(),
      base::Key{"period_s", &LoopSpec::period_s, "s", "One tick, h"}
          .in({0, 1, true, false})
          .by_default(),
      base::Key{"duration_s", &LoopSpec::duration_s, "s", "A whole number of periods, at most 1e9"}
          .in(base::positive)
          .by_default(),
      base::Key{"command_delay", &LoopSpec::command_delay, "ticks",
                "The torque computed from tick k acts over tick k + delay"}
          .in({0, plant::max_delay_ticks})
          .by_default(),
      base::Key{"max_missed", &LoopSpec::max_missed, "ticks",
                "Realtime: commands missed in a row before the protective stop. Not given, `run "
                "--plant` takes the number that the loop tolerates (searched), if that is less"}
          .in({0, 1e6})
          .by_default(),
      base::Key{"max_missed_share", &LoopSpec::max_missed_share, "",
                "Realtime: share of deadlines that the plant may miss; a run that missed more "
                "ends with exit code 1"}
          .in({0, 1})
          .by_default(),
      base::Key{"give_up_s", &LoopSpec::give_up_s, "s", "A peer silent for this long is lost"}
          .in({0, 3600, true, false})
          .by_default()};
};

struct Scenario {
  std::string name;
  RobotSpec robot;
  plant::Spec plant;
  reference::Spec reference;
  controller::Spec controller;
  LoopSpec loop;

  /// Robot of the URDF with the scenario's gravity and base, without rotors and payload. It is read
  /// once. The caller that reads the scenario shows its warnings.
  std::shared_ptr<const robot::Model> model;
  /// Robot of controller.urdf; null without that key: the law's model is the plant's.
  std::shared_ptr<const robot::Model> believed_model;
  int num_joints = 0;
  /// YAML with `--set` applied. `parse_scenario` makes the same scenario of it.
  std::string text;
  std::int64_t digest = 0;  ///< digest of `text` and the URDF
  std::string source;       ///< file name for messages
  /// "controller.gains.kp" -> "<file>:<line>", or the "--set <key=value>" that gave its value
  std::map<std::string, std::string> where;

  /// Returns true if the file or --set gives the key.
  [[nodiscard]] bool gives(const std::string& key) const { return where.count(key) != 0; }

  /// Returns a Failure(bad_usage) that reads "<where>: <key>: <problem>".
  [[nodiscard]] base::Failure complaint(const std::string& key, std::string_view problem) const;
  template <class First, class... Rest>
  [[nodiscard]] base::Failure complaint(const std::string& key,
                                        fmt::format_string<First, Rest...> problem, First&& first,
                                        Rest&&... rest) const {
    return complaint(key, std::string_view(fmt::format(problem, std::forward<First>(first),
                                                       std::forward<Rest>(rest)...)));
  }

  /// Checks that the scenario asks for a controller with this law. The names have to agree unless
  /// the law is external. The measurements have to agree if the scenario gives one.
  /// @throw base::Failure(bad_usage) for another controller
  void require_law(const messages::LawInfo& law) const;

  [[nodiscard]] std::optional<base::Refusal> refusal() const;

  static constexpr std::tuple keys{
      base::Key{"name", &Scenario::name, "",
                "Name of the experiment: letters, digits, `.`, `_`, `-`, at most 100"},
      base::Key{"robot", &Scenario::robot},
      base::Key{"plant", &Scenario::plant},
      base::Key{"reference", &Scenario::reference, "", "Motion that the robot is to follow"},
      base::Key{"controller", &Scenario::controller},
      base::Key{"loop", &Scenario::loop}};
};

/// Reads `path` and the URDF it names (relative to the scenario's file). `overrides` are
/// "key.path=value" as given to --set; a value is YAML.
/// @throw Failure(bad_usage), one line: file, line, key, value, allowed range, nearest known key.
Scenario load_scenario(const std::filesystem::path& path,
                       const std::vector<std::string>& overrides = {});

/// Reads a scenario from texts, as a log holds them. `urdf_text` is `RobotSpec::urdf_text`, or a
/// URDF file without controller.urdf, which no override may name. `source` replaces the file name.
/// @param folder of the file of joint parameters that an override names; none: no file is read
Scenario parse_scenario(std::string_view text, std::string_view urdf_text,
                        const std::string& source, const std::vector<std::string>& overrides = {},
                        const std::optional<std::filesystem::path>& folder = {});

/// Checks the rules between keys of `robot` and `plant` in a scenario that has its model.
/// @throw Failure(bad_usage), one line: where, key, value, what is allowed.
void require_consistent(const Scenario& scenario);

/// Options of `urdf_scenario`.
struct UrdfScenario {
  std::string name;
  std::string urdf;  ///< path of the URDF for the file
  double period_s = 1e-3;
  Vector from{};              ///< start of the motion [rad; m]; empty: chosen by `urdf_scenario`
  bool adds_gravity = false;  ///< the arm's own controller adds g(q)
};

/// Returns the posture of a description's keyframe in the order of the model's joints. Returns
/// nothing without a keyframe, or if a joint is outside its range there.
Vector start_posture(const robot::Description& description, const robot::Model& model);

/// Returns the text of a scenario for a URDF alone. The gains are useful only after a design. The
/// motion begins in the middle of the joints' ranges, or near it with no link below the base's
/// plane. It ends 0.3 rad (0.1 m) away, on the side of the farther limit. The scenario has a 20-bit
/// encoder, one tick of delay, and the URDF's friction fed forward. The drives hold the robot until
/// the first command acts.
std::string urdf_scenario(const robot::Model& model, const UrdfScenario& options);

/// Returns `model` with the scenario's payload, or unchanged without a payload.
/// @throw Failure(bad_usage) when the payload has no link to be on or no body can have its inertia.
robot::Model with_payload(const Scenario& scenario, robot::Model model);

/// Returns the model whose torques the arm's own controller adds. It is the model of
/// robot.compensates.urdf, which is read now, or else the plant's. Its gravity is by
/// robot.compensates.base_rpy.
/// @throw Failure(bad_usage) when the file cannot be read or has other joints
robot::Model own_model(const Scenario& scenario);

/// A robot's file (a URDF, an .xacro or an MJCF) with the options that overrides of `robot` give. A
/// command without a scenario uses it.
struct RobotFile : robot::Description {
  robot::UrdfOptions options;
};
RobotFile robot_file(const std::filesystem::path& file, const std::vector<std::string>& overrides);

/// Returns the width of one count of each joint's position encoder [rad; m if prismatic]; 0: ideal.
/// @throw Failure(bad_usage) when a prismatic joint has a resolution but no range.
Vector encoder_count(const Scenario& scenario, const robot::Model& model);

/// Checks that the robot has the encoders for a law with the measurement of this channel suffix.
/// @throw Failure(bad_usage) naming the key and what is allowed.
void require_encoders(const Scenario& scenario, std::string_view measurement);

}  // namespace tachless::scenario
