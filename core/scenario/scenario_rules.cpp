#include "scenario/scenario.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <type_traits>

#include "base/text.h"
#include "messages/measurements.h"

namespace tachless::scenario {
namespace {

using base::shortest;

void require_possible_initial_state(const Scenario& scenario) {
  const Vector& position = scenario.plant.initial.position_rad;
  const robot::Model& model = *scenario.model;
  for (int i = 0; i < scenario.num_joints; ++i) {
    if (position[i] >= model.lower[i] && position[i] <= model.upper[i]) continue;
    const auto joint = static_cast<std::size_t>(i);
    const bool degrees = model.joint_types[joint] == robot::JointType::revolute &&
                         std::abs(position[i]) > 2 * std::numbers::pi;
    throw scenario.complaint(
        "plant.initial.position_rad",
        "{} of joint {} is outside its limits in the URDF; allowed: in [{}, {}]{}",
        shortest(position[i]), model.joint_names[joint], shortest(model.lower[i]),
        shortest(model.upper[i]), degrees ? "; angles are in rad, were degrees given?" : "");
  }
}

/// Refuses the keys of flexible joints on a rigid robot.
void require_motors_only_behind_springs(const Scenario& scenario) {
  if (scenario.robot.flexible) return;
  for (const char* key :
       {"plant.initial.motor_position_rad", "plant.initial.motor_velocity_rad_per_s"}) {
    if (!scenario.gives(key)) continue;
    throw scenario.complaint(
        key, "the robot has rigid joints; allowed: only with robot.joints: {flexible: …}");
  }
  if (scenario.plant.encoder.side == plant::EncoderSide::motor) {
    throw scenario.complaint(
        "plant.encoder.side",
        "motor: the robot has rigid joints; allowed: link, both, or robot.joints: {flexible: …}");
  }
}

void require_link(const Scenario& scenario, const std::string& key, const std::string& link) {
  const robot::Model& model = *scenario.model;
  if (link.empty() || model.frames.count(link) != 0) return;
  std::vector<std::string_view> links;
  for (const auto& [each, frame] : model.frames) links.push_back(each);
  throw scenario.complaint(key, "\"{}\" is not in the URDF; allowed: {}", link,
                           base::joined(links));
}

void require_disturbed(const Scenario& scenario) {
  const std::vector<std::string>& joints = scenario.model->joint_names;
  std::size_t i = 0;
  for (const plant::DisturbanceSpec& each : scenario.plant.disturbances) {
    const std::string place = fmt::format("plant.disturbances[{}]", i++);
    require_link(scenario, place + ".link", each.link);
    if (each.joint.empty() || std::find(joints.begin(), joints.end(), each.joint) != joints.end())
      continue;
    throw scenario.complaint(place + ".joint", "\"{}\" is no joint of the robot; allowed: {}",
                             each.joint, base::joined(joints));
  }
}

void require_static_above_coulomb(const Scenario& scenario) {
  const plant::DriveSpec& drive = scenario.plant.drive;
  if (!drive.static_friction_Nm) return;
  for (int i = 0; i < scenario.num_joints; ++i) {
    const double least = drive.coulomb_friction_Nm[i], given = (*drive.static_friction_Nm)[i];
    if (given >= least) continue;
    throw scenario.complaint(
        "plant.drive.static_friction_Nm",
        "{} of joint {} is below its Coulomb friction; allowed: at least {}", shortest(given),
        scenario.model->joint_names[static_cast<std::size_t>(i)], shortest(least));
  }
}

void require_possible_friction(const Scenario& scenario) {
  const plant::DriveSpec& drive = scenario.plant.drive;
  for (int i = 0; i < scenario.num_joints; ++i) {
    const std::string& joint = scenario.model->joint_names[static_cast<std::size_t>(i)];
    const robot::JointFriction friction = drive.friction_of(i);
    if (friction.rise < -friction.coulomb) {
      throw scenario.complaint("plant.drive.friction_rise_Nm",
                               "{} of joint {}: friction would drive it; allowed: at least {}, its "
                               "Coulomb friction reversed",
                               shortest(friction.rise), joint, shortest(-friction.coulomb));
    }
    const double forward = scenario.controller.friction.rise[i],
                 least = -scenario.controller.friction.coulomb[i];
    if (forward < least) {
      throw scenario.complaint(
          "controller.friction.rise",
          "{} of joint {}: friction would drive it; allowed: at least {}, its coulomb reversed",
          shortest(forward), joint, shortest(least));
    }
    if (friction.load > 0 && friction.held == 0) {
      throw scenario.complaint("plant.drive.load_friction",
                               "{} of joint {}, which has no other dry friction; allowed: 0, or "
                               "plant.drive.coulomb_friction_Nm above 0",
                               shortest(friction.load), joint);
    }
  }
}

}  // namespace

void require_consistent(const Scenario& scenario) {
  const RobotSpec& robot = scenario.robot;
  if (!robot.xacro.empty() && !robot.urdf_path.ends_with(".xacro")) {
    throw scenario.complaint("robot.xacro", "arguments, but robot.urdf is {}; allowed: .xacro",
                             robot.urdf_path);
  }
  require_possible_initial_state(scenario);
  require_motors_only_behind_springs(scenario);
  require_static_above_coulomb(scenario);
  require_possible_friction(scenario);
  require_link(scenario, "plant.payload.link", scenario.plant.payload.link);
  with_payload(scenario, *scenario.model);
  require_disturbed(scenario);
}

robot::Model with_payload(const Scenario& scenario, robot::Model model) {
  const plant::PayloadSpec& payload = scenario.plant.payload;
  if (payload.mass_kg == 0) return model;
  const std::vector<double>& I = payload.inertia_kgm2;
  robot::MassProperties body;
  body.mass = payload.mass_kg;
  body.p_Bcm = Eigen::Vector3d(payload.center_of_mass_m.data());
  body.I_Bcm << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  if (const std::string why = robot::why_not_physical(body); !why.empty()) {
    throw scenario.complaint("plant.payload.inertia_kgm2", why);
  }
  try {
    return robot::with_payload(std::move(model), body, payload.link);
  } catch (const std::invalid_argument& error) {
    throw scenario.complaint("plant.payload.link", error.what());
  }
}

Vector encoder_count(const Scenario& scenario, const robot::Model& model) {
  Vector count = Vector::Zero(model.num_joints);
  const std::optional<Vector>& bits = scenario.plant.encoder.resolution_bits;
  if (!bits) return count;
  for (int i = 0; i < model.num_joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    const bool prismatic = model.joint_types[joint] == robot::JointType::prismatic;
    const double range = prismatic ? model.upper[i] - model.lower[i] : 2 * std::numbers::pi;
    if (!(std::isfinite(range) && range > 0)) {
      throw scenario.complaint("plant.encoder.resolution_bits",
                               "{} needs a range to count over, but prismatic joint \"{}\" has no "
                               "lower and upper limit in the URDF; add them, or use null (ideal)",
                               (*bits)[i], model.joint_names[joint]);
    }
    count[i] = std::ldexp(range, -static_cast<int>((*bits)[i]));
  }
  return count;
}

void require_encoders(const Scenario& scenario, std::string_view measurement) {
  bool on_links = false, on_motors = false;
  messages::with_measurement(measurement, [&]<class M>(std::type_identity<M> /*type*/) {
    on_links = messages::holds_links<M>;
    on_motors = messages::holds_motors<M>;
  });
  const std::string& law = scenario.controller.law;
  if (!scenario.robot.flexible) {  // one position per joint, whichever side its encoder is on
    if (!on_motors || measurement == messages::StateMeasurement::suffix) return;
    throw scenario.complaint("robot.joints",
                             "rigid, but law {} measures motor positions; allowed: flexible", law);
  }
  const plant::EncoderSide side = scenario.plant.encoder.side;
  const bool missing = (on_links && side == plant::EncoderSide::motor) ||
                       (on_motors && side == plant::EncoderSide::link);
  if (!missing) return;
  throw scenario.complaint("plant.encoder.side", "{}; allowed with law {}: both{}{}",
                           base::name_of(side), law, on_links ? "" : " or motor",
                           on_motors ? "" : " or link");
}

}  // namespace tachless::scenario
