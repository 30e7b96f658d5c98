#include "cli/design_input.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "base/failure.h"
#include "base/logging.h"
#include "cli/design_text.h"
#include "cli/verb.h"
#include "plant/mujoco/mujoco.h"
#include "robot/mjcf_scene.h"
#include "robot/typical_rotors.h"
#include "robot/urdf_xml.h"
#include "scenario/description.h"
#include "scenario/yaml_tree.h"

namespace tachless::cli {
namespace {

/// Returns whether the file is an MJCF with something beside the robot.
bool is_scene(const std::filesystem::path& file, const scenario::RobotFile& robot) {
  return !robot.mjcf.empty() &&
         robot::has_surroundings(robot.mjcf, file.string(), scenario::files_beside(file));
}

}  // namespace

DesignInput::DesignInput(Options options) : options_(std::move(options)) {
  if (!is_yaml(options_.file)) {
    const scenario::RobotFile file = scenario::robot_file(options_.file, options_.overrides);
    if (file.urdf.find("<robot") != std::string::npos) {
      urdf_ = read_urdf(file);
      return;
    }
  }
  if (!options_.from.empty()) {
    throw base::bad_usage(
        "--from: only for a URDF; in a scenario set plant.initial.position_rad and reference");
  }
  if (options_.typical_rotors) {
    throw base::bad_usage(
        "--rotors: only for a URDF; in a scenario set robot.joints.rigid.rotor_inertia_kgm2");
  }
}

DesignInput::Urdf DesignInput::read_urdf(const scenario::RobotFile& file) const {
  const std::string source = options_.file.string();
  for (const std::string& each : options_.overrides) {
    if (!each.starts_with("robot.urdf=")) continue;
    throw base::bad_usage("--set {}: the URDF is {}; name another in its place", each, source);
  }
  if (options_.typical_rotors &&
      (overridden("robot.joint_parameters=") || overridden("robot.joints"))) {
    throw base::bad_usage(
        "--rotors typical: --set gives the rotors already; leave one of them out");
  }
  for (const std::string& warning : file.warnings) base::log_warning(warning);
  try {
    const robot::Model model = robot::read_urdf(file.urdf, source, file.options);
    for (const std::string& doubt :
         robot::improbable_numbers(file.urdf, source, file.options.locked)) {
      base::log_warning(doubt);
    }
    scenario::UrdfScenario made{
        scenario_name(options_.output.empty() ? options_.file : options_.output),
        path_from(options_.output, options_.file),
        options_.period_s > 0 ? options_.period_s : 1e-3};
    made.from = options_.from.empty() ? scenario::start_posture(file, model) : from_posture(model);
    made.adds_gravity = file.adds_gravity;
    Urdf urdf{file.urdf, scenario::urdf_scenario(model, made), {}, false};
    if (is_scene(options_.file, file)) {
      urdf.in_mujoco = plant::has_mujoco_module();
      base::log_info(urdf.in_mujoco
                         ? "the model has more than the robot: MuJoCo moves it (plant.mujoco)"
                         : "the model has more than the robot, which is left out: no module for "
                           "MuJoCo (package tachless-mujoco)");
    }
    if (options_.typical_rotors) urdf.typical_rotors = robot::typical_rotor_inertia(model);
    return urdf;
  } catch (const std::invalid_argument& problem) {
    throw base::bad_usage(problem.what());
  }
}

scenario::Scenario DesignInput::scenario(std::optional<design::Structure> structure,
                                         std::vector<std::string> more) const {
  if (options_.period_s > 0) more.push_back(fmt::format("loop.period_s={}", options_.period_s));
  if (structure) {
    more.insert(more.begin(), {"controller.gains={}",
                               fmt::format("controller.law={}", design::law_of(*structure))});
  }
  more.insert(more.begin(), options_.overrides.begin(), options_.overrides.end());
  if (!urdf_) return scenario::load_scenario(options_.file, more);
  if (urdf_->typical_rotors.size() > 0) {
    more.push_back(fmt::format("robot.joints={{rigid: {{rotor_inertia_kgm2: [{}]}}}}",
                               fmt::join(urdf_->typical_rotors, ", ")));
  }
  if (urdf_->in_mujoco) {
    more.push_back(
        scenario::text_override("plant.mujoco.model", path_from(options_.output, options_.file)));
  }
  return scenario::parse_scenario(urdf_->scenario, urdf_->text, options_.file.string(), more,
                                  std::filesystem::path());
}

std::vector<std::string> DesignInput::assumptions(const scenario::Scenario& scenario) const {
  std::vector<std::string> assumed;
  if (!urdf_) return assumed;
  const auto assume = [&](std::string_view key, const std::string& what) {
    if (!overridden(key)) assumed.push_back(fmt::format("{} ({})", what, key));
  };
  if (const auto& bits = scenario.plant.encoder.resolution_bits; bits && bits->size() > 0) {
    assume("plant.encoder.resolution_bits", fmt::format("encoders of {:g} bits", (*bits)[0]));
  }
  assume("loop.command_delay", fmt::format("{} tick of delay", scenario.loop.command_delay));
  if (urdf_->typical_rotors.size() > 0) {
    assume("robot.joints.rigid.rotor_inertia_kgm2",
           fmt::format("rotors by a rule of thumb, {:g} s2 times the effort limit; published ones "
                       "have 0.7 to 4 times it",
                       robot::rotor_inertia_per_torque));
  } else if (scenario.robot.rigid_rotor_inertia_kgm2.isZero(0)) {
    assume("robot.joint_parameters",
           "no rotors, since the URDF has none: gains are 2 to 20 times softer than with them; "
           "--rotors typical assumes some, excite and identify find them");
  }
  const plant::DriveSpec& drive = scenario.plant.drive;
  const bool rubs =
      !drive.viscous_friction_Nms_per_rad.isZero(0) || !drive.coulomb_friction_Nm.isZero(0);
  assume("plant.drive.coulomb_friction_Nm",
         rubs ? "the URDF's friction" : "no friction, since the URDF has none");
  assume("plant.drive.torque_limit_Nm",
         drive.torque_limit_Nm ? "the URDF's effort limits" : "no torque limits");
  if (const std::string lock = finger_lock(*scenario.model); !lock.empty()) {
    assume("robot.locked",
           "fingers move and have gains like the arm's joints; " + lock + " holds them");
  }
  return assumed;
}

bool DesignInput::overridden(std::string_view key) const {
  return std::ranges::any_of(options_.overrides,
                             [&](const std::string& each) { return each.starts_with(key); });
}

Vector DesignInput::from_posture(const robot::Model& model) const {
  const std::vector<double>& from = options_.from;
  if (std::ssize(from) != model.num_joints) {
    throw base::bad_usage("--from has {} numbers; allowed: {}, one a joint", from.size(),
                          model.num_joints);
  }
  for (int i = 0; i < model.num_joints; ++i) {
    const double q = from[static_cast<std::size_t>(i)];
    if (q >= model.lower[i] && q <= model.upper[i]) continue;
    throw base::bad_usage("--from: {:g} for joint {}; allowed: {:g} to {:g}", q,
                          model.joint_names[static_cast<std::size_t>(i)], model.lower[i],
                          model.upper[i]);
  }
  return Vector::Map(from.data(), std::ssize(from));
}

}  // namespace tachless::cli
