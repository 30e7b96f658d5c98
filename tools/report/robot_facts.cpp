#include "report/robot_facts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/failure.h"
#include "base/json_text.h"
#include "base/text.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::report {
namespace {

using robot::JointType;
using robot::Model;

std::string_view type_of(const Model& model, int joint) {
  if (model.joint_types[static_cast<std::size_t>(joint)] == JointType::prismatic) {
    return "prismatic";
  }
  const bool ranges = std::isfinite(model.lower[joint]) || std::isfinite(model.upper[joint]);
  return ranges ? "revolute" : "continuous";
}

Vector position_of(const Model& model, const std::vector<double>& given) {
  if (given.empty()) return robot::nearest_to_zero(model);
  if (static_cast<int>(given.size()) != model.num_joints) {
    throw base::bad_usage("--position: {} numbers; the robot has {} joints: {}", given.size(),
                          model.num_joints, fmt::join(model.joint_names, ", "));
  }
  return Eigen::Map<const Eigen::VectorXd>(given.data(), model.num_joints);
}

std::string number(double value) {
  if (std::abs(value) < 1e-12) return "0";
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : "-";
}

/// The per-joint numbers of a model: their keys, which are also the headings of their columns.
constexpr std::array<std::pair<const char*, Vector Model::*>, 6> joint_numbers = {
    {{"lower", &Model::lower},
     {"upper", &Model::upper},
     {"effort", &Model::effort_limit},
     {"velocity", &Model::velocity_limit},
     {"damping", &Model::damping},
     {"friction", &Model::friction}}};

}  // namespace

RobotFacts::RobotFacts(Model read, const std::vector<double>& position)
    : model(std::move(read)),
      q(position_of(model, position)),
      inertia(robot::mass_matrix(model, q)),
      gravity_torque(robot::gravity_torque(model, q)),
      warnings(model.warnings),
      rotor_inertia(model.rotor_inertia) {
  if (rotor_inertia.size() == 0) rotor_inertia = Vector::Zero(model.num_joints);
  for (const robot::Body& body : model.bodies) mass_kg += body.mass;
  const Vector moments = numerics::symmetric_eigenvalues(inertia);
  condition_number = moments[moments.size() - 1] / moments[0];
  for (int j = 0; j < model.num_joints; ++j) {
    if (q[j] >= model.lower[j] && q[j] <= model.upper[j]) continue;
    warnings.push_back(fmt::format("position {:g} of joint {} is outside its range [{:g}, {:g}]",
                                   q[j], model.joint_names[static_cast<std::size_t>(j)],
                                   model.lower[j], model.upper[j]));
  }
}

std::string to_text(const RobotFacts& facts) {
  const Model& model = facts.model;
  std::string text = fmt::format(
      "{} joints, {} bodies, {:.4g} kg that move; the root link is fixed to the ground\n"
      "  lengths in rad, or m of prismatic joints; torques in N m, or N; inertia in kg m2, or kg\n",
      model.num_joints, model.bodies.size(), facts.mass_kg);
  std::vector<std::vector<std::string>> rows = {{"joint", "type"}};
  for (const auto& [key, member] : joint_numbers) rows[0].emplace_back(key);
  rows[0].insert(rows[0].end(), {"rotor", "position", "gravity torque", "inertia"});
  for (int j = 0; j < model.num_joints; ++j) {
    std::vector<std::string>& row = rows.emplace_back();
    row = {model.joint_names[static_cast<std::size_t>(j)], std::string(type_of(model, j))};
    for (const auto& [key, member] : joint_numbers) row.push_back(number((model.*member)[j]));
    for (const double value :
         {facts.rotor_inertia[j], facts.q[j], facts.gravity_torque[j], facts.inertia(j, j)}) {
      row.push_back(number(value));
    }
  }
  text += base::table(rows, "lr");
  constexpr int shown = 10;
  text += fmt::format("inertia matrix{}, condition number {:.3g}\n",
                      model.num_joints > shown ? ": see --json" : "", facts.condition_number);
  if (model.num_joints <= shown) {
    std::vector<std::vector<std::string>> entries(static_cast<std::size_t>(model.num_joints));
    for (int i = 0; i < model.num_joints; ++i) {
      for (const double value : facts.inertia.row(i)) {
        entries[static_cast<std::size_t>(i)].push_back(number(value));
      }
    }
    text += base::table(entries, "lr");
  }
  if (!facts.sources.empty()) {
    text += "in use by the loop, and its source\n";
    std::vector<std::vector<std::string>> lines;
    for (const auto& [what, source] : facts.sources) lines.push_back({what, source});
    text += base::table(lines, "l");
  }
  for (const std::string& warning : facts.warnings) text += "warning: " + warning + "\n";
  return text;
}

nlohmann::ordered_json to_json(const RobotFacts& facts) {
  using nlohmann::ordered_json;
  const Model& model = facts.model;
  const auto limit = [](double value) {
    return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
  };
  ordered_json joints = ordered_json::array();
  for (int j = 0; j < model.num_joints; ++j) {
    ordered_json& joint = joints.emplace_back();
    joint = {{"name", model.joint_names[static_cast<std::size_t>(j)]}, {"type", type_of(model, j)}};
    for (const auto& [key, member] : joint_numbers) joint[key] = limit((model.*member)[j]);
    joint["rotor_inertia"] = facts.rotor_inertia[j];
  }
  ordered_json inertia = ordered_json::array();
  for (int i = 0; i < model.num_joints; ++i)
    inertia.push_back(base::json_list(facts.inertia.row(i)));
  ordered_json sources = ordered_json::object();
  for (const auto& [what, source] : facts.sources) sources[what] = source;
  return {{"joints", joints},
          {"bodies", model.bodies.size()},
          {"mass_kg", facts.mass_kg},
          {"position", base::json_list(facts.q)},
          {"inertia_matrix", inertia},
          {"gravity_torque", base::json_list(facts.gravity_torque)},
          {"condition_number", limit(facts.condition_number)},
          {"sources", sources},
          {"warnings", facts.warnings}};
}

}  // namespace tachless::report
