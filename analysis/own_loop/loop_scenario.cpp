#include "own_loop/loop_scenario.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>

#include "base/failure.h"
#include "base/file_text.h"
#include "robot/model.h"
#include "scenario/yaml_tree.h"

namespace tachless::own_loop {
namespace {

namespace fs = std::filesystem;
using scenario::YamlNode;

/// Returns the value at a path such as "loop.period_s"; null if it is not given.
const YamlNode* value_at(const YamlNode& root, std::initializer_list<std::string_view> path) {
  const YamlNode* node = &root;
  for (const std::string_view key : path) {
    if (node != nullptr) node = node->find(key);
  }
  return node;
}

double number_at(const YamlNode& root, std::initializer_list<std::string_view> path,
                 double otherwise) {
  const YamlNode* node = value_at(root, path);
  return node == nullptr ? otherwise : std::strtod(node->scalar.c_str(), nullptr);
}

/// Returns the overrides of `robot` that give the tree's keys again.
std::vector<std::string> robot_overrides(const YamlNode& root) {
  std::vector<std::string> all;
  for (const std::string key : {"xacro", "check_inertia", "locked", "base"}) {
    const YamlNode* node = value_at(root, {"robot", key});
    if (node != nullptr) all.push_back(fmt::format("robot.{}={}", key, emit_yaml(*node)));
  }
  return all;
}

robot::Model model_of(const scenario::RobotFile& file, const std::string& path) {
  try {
    return robot::model_from_urdf(file.urdf, path, file.options);
  } catch (const std::invalid_argument& problem) {
    throw base::bad_usage(problem.what());
  }
}

std::string list_text(const Vector& values) {
  return fmt::format("[{}]", fmt::join(values.begin(), values.end(), ", "));
}

/// Returns true if the value at a path may get keys: a map, or none.
bool may_have_keys(const YamlNode& root, std::initializer_list<std::string_view> path) {
  const YamlNode* node = value_at(root, path);
  return node == nullptr || node->kind == YamlNode::Kind::map || node->kind == YamlNode::Kind::null;
}

/// Returns overrides for what the tree lacks and a law does not need. A value that is there and
/// wrong stays, to be refused.
/// @param rest a posture within the joints' ranges
std::vector<std::string> missing_keys(const YamlNode& root, const Vector& rest) {
  std::vector<std::string> all;
  if (value_at(root, {"reference"}) == nullptr) {
    all.push_back(fmt::format("reference={{hold: {{position_rad: {}}}}}", list_text(rest)));
  }
  if (value_at(root, {"plant", "initial", "position_rad"}) == nullptr &&
      may_have_keys(root, {"plant"}) && may_have_keys(root, {"plant", "initial"})) {
    all.push_back("plant.initial.position_rad=" + list_text(rest));
  }
  const double period_s = number_at(root, {"loop", "period_s"}, scenario::LoopSpec().period_s);
  const double given_s = number_at(root, {"loop", "duration_s"}, 1000 * period_s);
  if (period_s > 0 && given_s > 0 && may_have_keys(root, {"loop"})) {
    const double ticks = std::max(1.0, std::round(given_s / period_s));
    all.push_back(fmt::format("loop.duration_s={}", ticks * period_s));
  }
  return all;
}

/// Returns "kp: [400, 300], kd: [40, 30]".
std::string gains_text(const std::map<std::string, std::vector<double>>& gains) {
  std::vector<std::string> each;
  for (const auto& [name, values] : gains) {
    each.push_back(fmt::format("{}: [{}]", name, fmt::join(values, ", ")));
  }
  return fmt::format("{}", fmt::join(each, ", "));
}

void apply_all(YamlNode& root, const std::vector<std::string>& overrides) {
  for (const std::string& each : overrides) apply_override(root, each);
}

}  // namespace

LoopScenario read_loop_scenario(const std::string& file, const std::vector<std::string>& set) {
  YamlNode root = scenario::parse_yaml(base::given_text(file, base::max_text_bytes), file);
  if (root.kind != YamlNode::Kind::map)
    return {scenario::load_scenario(file, set), true};  // throws
  apply_all(root, set);
  std::vector<std::string> overrides = set;
  if (const YamlNode* urdf = value_at(root, {"robot", "urdf"})) {
    const std::string path = (fs::path(file).parent_path() / urdf->scalar).string();
    const robot::Model model = model_of(scenario::robot_file(path, robot_overrides(root)), path);
    const std::vector<std::string> more = missing_keys(root, robot::nearest_to_zero(model));
    overrides.insert(overrides.end(), more.begin(), more.end());
  }
  return {scenario::load_scenario(file, overrides), value_at(root, {"reference"}) != nullptr};
}

LoopScenario make_loop_scenario(const LawSettings& law, const std::vector<std::string>& set) {
  const scenario::RobotFile file = scenario::robot_file(law.urdf, set);
  const robot::Model model = model_of(file, law.urdf);
  if (!(law.period_s > 0 && law.period_s <= 1)) {
    throw base::bad_usage("period_s: {}; allowed: above 0, at most 1 s", law.period_s);
  }
  const std::string whole =
      scenario::urdf_scenario(model, {"own_loop", law.urdf, law.period_s, {}});
  YamlNode root = scenario::parse_yaml(whole, law.urdf);
  const auto reference = std::ranges::find(root.keys, "reference");
  root.children.erase(root.children.begin() + (reference - root.keys.begin()));
  root.keys.erase(reference);
  apply_all(root, {"controller.law=" + law.law,
                   fmt::format("controller.gains={{{}}}", gains_text(law.gains)),
                   fmt::format("loop.period_s={}", law.period_s),
                   fmt::format("loop.command_delay={}", law.command_delay)});
  apply_all(root, set);
  const bool has_reference = value_at(root, {"reference"}) != nullptr;
  apply_all(root, missing_keys(root, robot::nearest_to_zero(model)));
  return {scenario::parse_scenario(emit_yaml(root), file.urdf, law.urdf, {},
                                   fs::path(law.urdf).parent_path()),
          has_reference};
}

}  // namespace tachless::own_loop
