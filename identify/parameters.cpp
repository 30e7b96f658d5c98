#include "identify/parameters.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <memory>
#include <utility>

namespace tachless::identify {
namespace {

/// N m, N m s/rad and kg m², or on a prismatic joint N, N s/m and kg.
std::string unit_of(Kind kind, bool turns) {
  switch (kind) {
    case Kind::rotor:
      return turns ? "kg m2" : "kg";
    case Kind::viscous:
      return turns ? "N m s/rad" : "N s/m";
    case Kind::coulomb:
      return turns ? "N m" : "N";
    case Kind::payload:
      return "kg";
  }
  return "";
}

}  // namespace

Parameters::Parameters(const experiment::Scenario& scenario, const std::vector<Kind>& unknown) {
  for (const Kind kind : unknown) {
    const std::string name(kind_names[static_cast<std::size_t>(kind)]);
    if (kind == Kind::payload) {
      entries_.push_back({kind, -1, name, unit_of(kind, true)});
      continue;
    }
    for (int i = 0; i < scenario.num_joints; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const bool turns = scenario.model->joint_types[at] == robot::JointType::revolute;
      entries_.push_back(
          {kind, i, name + " " + scenario.model->joint_names[at], unit_of(kind, turns)});
    }
  }
}

experiment::Scenario Parameters::plant(const experiment::Scenario& scenario,
                                       const Eigen::VectorXd& values) const {
  experiment::Scenario changed = scenario;
  plant::DriveSpec& drive = changed.plant.drive;
  drive.static_friction_Nm.reset();
  for (Eigen::Index i = 0; i < size(); ++i) {
    const Entry& entry = entries_[static_cast<std::size_t>(i)];
    const double value = values[i];
    switch (entry.kind) {
      case Kind::rotor:
        changed.robot.rigid_rotor_inertia_kgm2[entry.joint] = value;
        break;
      case Kind::viscous:
        drive.viscous_friction_Nms_per_rad[entry.joint] = value;
        break;
      case Kind::coulomb:
        drive.coulomb_friction_Nm[entry.joint] = value;
        break;
      case Kind::payload:
        changed.plant.payload.mass_kg = value;
        break;
    }
  }
  changed.plant.mechanics = plant::Mechanics::native;
  // What the recorded run did beyond the URDF's range and speed it does again, without a warning.
  auto model = std::make_shared<robot::Model>(*scenario.model);
  model->lower.setConstant(-robot::Model::unlimited);
  model->upper.setConstant(robot::Model::unlimited);
  model->velocity_limit.setConstant(robot::Model::unlimited);
  changed.model = std::move(model);
  changed.plant.on_limit = plant::OnLimit::warn;
  plant::EncoderSpec& encoder = changed.plant.encoder;
  encoder.resolution_bits.reset();
  encoder.noise_std_rad = encoder.velocity_noise_std_rad_per_s = 0;
  return changed;
}

std::vector<double> Parameters::of(Kind kind, const Eigen::VectorXd& values) const {
  std::vector<double> found;
  for (Eigen::Index i = 0; i < size(); ++i) {
    if (entries_[static_cast<std::size_t>(i)].kind == kind) found.push_back(values[i]);
  }
  return found;
}

std::vector<std::string> Parameters::overrides(const Eigen::VectorXd& values) const {
  constexpr std::array<std::pair<Kind, const char*>, 5> keys = {
      {{Kind::rotor, "robot.joints={{rigid: {{rotor_inertia_kgm2: [{:.6g}]}}}}"},
       {Kind::viscous, "plant.drive.viscous_friction_Nms_per_rad=[{:.6g}]"},
       {Kind::viscous, "controller.friction.viscous=[{:.6g}]"},
       {Kind::coulomb, "plant.drive.coulomb_friction_Nm=[{:.6g}]"},
       {Kind::coulomb, "controller.friction.coulomb=[{:.6g}]"}}};
  std::vector<std::string> result;
  for (const auto& [kind, key] : keys) {
    const std::vector<double> found = of(kind, values);
    if (!found.empty()) result.push_back(fmt::format(fmt::runtime(key), fmt::join(found, ", ")));
  }
  for (const double mass : of(Kind::payload, values)) {
    result.push_back(fmt::format("plant.payload.mass_kg={:.6g}", mass));
  }
  return result;
}

}  // namespace tachless::identify
