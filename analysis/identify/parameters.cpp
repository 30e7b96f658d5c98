#include "identify/parameters.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

namespace tachless::identify {
namespace {

/// Returns the unit: N m, N m s/rad and kg m² for a revolute joint; N, N s/m and kg for a prismatic
/// joint.
std::string unit_of(Kind kind, bool turns) {
  switch (kind) {
    case Kind::rotor:
      return turns ? "kg m2" : "kg";
    case Kind::viscous:
      return turns ? "N m s/rad" : "N s/m";
    case Kind::coulomb:
    case Kind::offset:
    case Kind::rise:
      return turns ? "N m" : "N";
    case Kind::load_friction:
      return "of gravity's torque";
    case Kind::delay:
      return "ticks";
    case Kind::payload:
    case Kind::inertia:
    case Kind::load:
      break;
  }
  return "kg";
}

/// Largest delay [ticks]: just below the tick after the longest delay of a drive.
constexpr double longest_delay = plant::max_delay_ticks + 0.999;

/// Smallest mass of a load that is in a model [kg].
constexpr double least_load = 1e-6;

constexpr std::array<const char*, 10> component_names = {"mass", "mx",  "my",  "mz",  "Ixx",
                                                         "Iyy",  "Izz", "Ixy", "Ixz", "Iyz"};

const char* unit_of_component(int c) { return c == 0 ? "kg" : c < 4 ? "kg m" : "kg m2"; }

}  // namespace

Inertial inertial_of(const robot::MassProperties& body) {
  const Eigen::Vector3d& c = body.p_Bcm;
  const Eigen::Matrix3d I =
      body.I_Bcm + body.mass * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
  Inertial value;
  value << body.mass, body.mass * c, I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2);
  return value;
}

robot::MassProperties mass_properties(const Inertial& value) {
  robot::MassProperties body;
  body.mass = value[0];
  if (body.mass != 0) body.p_Bcm = value.segment<3>(1) / body.mass;
  const Eigen::Vector3d& c = body.p_Bcm;
  body.I_Bcm << value[4], value[7], value[8], value[7], value[5], value[9], value[8], value[9],
      value[6];
  body.I_Bcm -= body.mass * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
  return body;
}

namespace {

/// Sets a further term of friction in the drives.
void set_term(plant::DriveSpec& drive, const Parameters::Entry& entry, double value) {
  if (entry.kind == Kind::load_friction) {
    drive.load_friction[entry.joint] = value;
  } else {
    drive.friction_rise_Nm[entry.joint] = value;
    drive.friction_rise_velocity_rad_per_s[entry.joint] = entry.velocity;
  }
}

}  // namespace

Parameters::Parameters(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                       bool controlled, const std::vector<FrictionTerm>& terms)
    : controlled_(controlled) {
  for (const Kind kind : unknown) {
    const std::string name(kind_names[static_cast<std::size_t>(kind)]);
    if (kind == Kind::payload || kind == Kind::delay) {
      entries_.push_back({kind, -1, name, unit_of(kind, true), controlled || kind != Kind::delay});
      continue;
    }
    if (kind == Kind::load) {
      for (int c = 0; c < std::ssize(component_names); ++c) {
        entries_.push_back({kind, -1,
                            fmt::format("payload {}", component_names[static_cast<std::size_t>(c)]),
                            unit_of_component(c), c == 0, c});
      }
      continue;
    }
    if (kind == Kind::inertia) {
      for (int body = 0; body < std::ssize(scenario.model->bodies); ++body) {
        for (int c = 0; c < std::ssize(component_names); ++c) {
          const auto at = static_cast<std::size_t>(c);
          entries_.push_back(
              {kind, body,
               fmt::format("{} {}", component_names[at],
                           scenario.model->bodies[static_cast<std::size_t>(body)].link),
               unit_of_component(c), false, c});
        }
      }
      continue;
    }
    for (int i = 0; i < scenario.num_joints; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const bool turns = scenario.model->joint_types[at] == robot::JointType::revolute;
      entries_.push_back({kind, i, name + " " + scenario.model->joint_names[at],
                          unit_of(kind, turns), kind != Kind::offset});
    }
  }
  for (const FrictionTerm& term : terms) {
    const auto at = static_cast<std::size_t>(term.joint);
    const bool turns = scenario.model->joint_types[at] == robot::JointType::revolute;
    entries_.push_back({term.kind, term.joint,
                        fmt::format("{} {}", kind_names[static_cast<std::size_t>(term.kind)],
                                    scenario.model->joint_names[at]),
                        unit_of(term.kind, turns), term.kind == Kind::load_friction, 0,
                        term.velocity, term.at_reversals});
  }
}

Eigen::Index Parameters::first(Kind kind) const {
  const auto found = std::ranges::find(entries_, kind, &Entry::kind);
  return found == entries_.end() ? -1 : found - entries_.begin();
}

Eigen::Index Parameters::num_turning() const {
  return std::ranges::count(entries_, true, &Entry::turns);
}

Eigen::VectorXd Parameters::velocities() const {
  Eigen::VectorXd result(num_turning());
  Eigen::Index at = 0;
  for (const Entry& each : entries_) {
    if (each.turns) result[at++] = each.velocity;
  }
  return result;
}

void Parameters::set_velocities(const Eigen::VectorXd& velocities) {
  Eigen::Index at = 0;
  for (Entry& each : entries_) {
    if (each.turns) each.velocity = velocities[at++];
  }
}

scenario::Scenario Parameters::plant(const scenario::Scenario& scenario,
                                     const Eigen::VectorXd& values) const {
  scenario::Scenario changed = scenario;
  changed.plant.mujoco = {};
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
      case Kind::rise:
      case Kind::load_friction:
        set_term(drive, entry, value);
        break;
      case Kind::payload:
        changed.plant.payload.mass_kg = value;
        break;
      case Kind::delay:
        changed.loop.command_delay = static_cast<int>(std::clamp(value, 0.0, longest_delay));
        drive.delay_fraction = std::clamp(value, 0.0, longest_delay) - changed.loop.command_delay;
        break;
      case Kind::load:
        changed.plant.payload.mass_kg = 0;  // the load is in the model below
        break;
      case Kind::inertia:
      case Kind::offset:
        break;
    }
  }
  changed.plant.mechanics = plant::Mechanics::native;
  // The recorded run may exceed the URDF's range and speed. The simulation may too, without a
  // warning.
  auto model = std::make_shared<robot::Model>(*scenario.model);
  if (const Eigen::Index first_of_bodies = first(Kind::inertia); first_of_bodies >= 0) {
    for (std::size_t body = 0; body < model->bodies.size(); ++body) {
      const Inertial change =
          values.segment<10>(first_of_bodies + 10 * static_cast<Eigen::Index>(body));
      robot::MassProperties& of_body = model->bodies[body];
      if (!change.isZero(0)) of_body = mass_properties(inertial_of(of_body) + change);
    }
  }
  if (const Eigen::Index load = first(Kind::load); load >= 0) {
    Inertial value = values.segment<10>(load);
    if (!value.isZero(0)) {
      value[0] = std::max(value[0], least_load);
      *model = robot::with_payload(std::move(*model), mass_properties(value),
                                   scenario.plant.payload.link);
    }
  }
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

Eigen::VectorXd Parameters::without_load(Eigen::VectorXd values) const {
  if (const Eigen::Index load = first(Kind::load); load >= 0) values.segment<10>(load).setZero();
  return values;
}

std::vector<double> Parameters::values_of(Kind kind, const Eigen::VectorXd& values) const {
  std::vector<double> found;
  for (Eigen::Index i = 0; i < size(); ++i) {
    if (entries_[static_cast<std::size_t>(i)].kind == kind) found.push_back(values[i]);
  }
  return found;
}

/// Appends overrides of the further terms of friction. Joints without one keep the scenario's.
void Parameters::add_terms_to(std::vector<std::string>& overrides,
                              const scenario::Scenario& scenario,
                              const Eigen::VectorXd& values) const {
  plant::DriveSpec drive = scenario.plant.drive;
  const auto add = [&](const char* key, const Vector& list) {
    overrides.push_back(fmt::format("{}=[{:.6g}]", key, fmt::join(list, ", ")));
  };
  for (Eigen::Index i = 0; i < size(); ++i) {
    const Entry& entry = entries_[static_cast<std::size_t>(i)];
    if (is_term(entry.kind)) set_term(drive, entry, values[i]);
  }
  if (first(Kind::rise) >= 0) {
    add("plant.drive.friction_rise_Nm", drive.friction_rise_Nm);
    add("plant.drive.friction_rise_velocity_rad_per_s", drive.friction_rise_velocity_rad_per_s);
    add("controller.friction.rise", drive.friction_rise_Nm);
    add("controller.friction.rise_velocity", drive.friction_rise_velocity_rad_per_s);
  }
  if (first(Kind::load_friction) >= 0) {
    add("plant.drive.load_friction", drive.load_friction);
    add("controller.friction.load", drive.load_friction);
  }
}

std::vector<std::string> Parameters::overrides(const scenario::Scenario& scenario,
                                               const Eigen::VectorXd& values) const {
  constexpr std::array<std::pair<Kind, const char*>, 5> keys = {
      {{Kind::rotor, "robot.joints={{rigid: {{rotor_inertia_kgm2: [{:.6g}]}}}}"},
       {Kind::viscous, "plant.drive.viscous_friction_Nms_per_rad=[{:.6g}]"},
       {Kind::viscous, "controller.friction.viscous=[{:.6g}]"},
       {Kind::coulomb, "plant.drive.coulomb_friction_Nm=[{:.6g}]"},
       {Kind::coulomb, "controller.friction.coulomb=[{:.6g}]"}}};
  std::vector<std::string> result;
  for (const auto& [kind, key] : keys) {
    const std::vector<double> found = values_of(kind, values);
    if (!found.empty()) result.push_back(fmt::format(fmt::runtime(key), fmt::join(found, ", ")));
  }
  const std::vector<double> coulomb = values_of(Kind::coulomb, values);
  if (!coulomb.empty() && scenario.plant.drive.static_friction_Nm) {
    result.push_back(
        fmt::format("plant.drive.static_friction_Nm=[{:.6g}]", fmt::join(coulomb, ", ")));
  }
  add_terms_to(result, scenario, values);
  for (const double mass : values_of(Kind::payload, values)) {
    result.push_back(fmt::format("plant.payload.mass_kg={:.6g}", mass));
  }
  for (const double delay : controlled_ ? values_of(Kind::delay, values) : std::vector<double>()) {
    const int whole = static_cast<int>(std::lround(delay)), own = scenario.loop.command_delay;
    result.push_back(fmt::format("loop.command_delay={}", std::min(whole, own)));
    result.push_back(
        fmt::format("plant.encoder.latency_ticks={}",
                    std::min(plant::max_delay_ticks,
                             scenario.plant.encoder.latency_ticks + std::max(0, whole - own))));
  }
  return result;
}

}  // namespace tachless::identify
