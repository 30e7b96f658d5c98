#include "scenario/joint_parameters.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file_text.h"
#include "base/text.h"
#include "scenario/description.h"
#include "scenario/reader.h"

namespace tachless::scenario {
namespace {

constexpr std::string_view key = "robot.joint_parameters";

/// An entry of the YAML file.
struct NumbersOfJoint {
  double rotor_inertia = 0, viscous_friction = 0, coulomb_friction = 0;

  static constexpr std::tuple keys{
      base::Key{"rotor_inertia_kgm2", &NumbersOfJoint::rotor_inertia}
          .in(base::not_negative)
          .by_default(),
      base::Key{"viscous_friction_Nms_per_rad", &NumbersOfJoint::viscous_friction}
          .in(base::not_negative)
          .by_default(),
      base::Key{"coulomb_friction_Nm", &NumbersOfJoint::coulomb_friction}
          .in(base::not_negative)
          .by_default()};
};

JointParameters read_yaml(const std::string& text, const std::string& source) {
  Scenario file;  // for complaints
  file.source = source;
  const YamlNode root = parse_yaml(text, source);
  const Place place{file, &root, ""};
  if (root.kind != YamlNode::Kind::map) {
    throw base::bad_usage("{}: {}; allowed: a map from joints to their numbers", source,
                          emit_line(root));
  }
  JointParameters parameters;
  for (const std::string& joint : root.keys) {
    NumbersOfJoint numbers;
    require_known_keys<NumbersOfJoint>(place.child(joint));
    read(place.child(joint), numbers);
    parameters[joint] = {numbers.rotor_inertia, numbers.viscous_friction, numbers.coulomb_friction};
  }
  return parameters;
}

/// Returns the map at `path` below `root`. Creates missing maps, and replaces a bare "rigid".
YamlNode* map_at(YamlNode& root, const std::vector<std::string>& path) {
  YamlNode* node = &root;
  for (const std::string& name : path) {
    YamlNode* child = node->find(name);
    if (child == nullptr) child = &node->add(name);
    if (child->kind == YamlNode::Kind::null ||
        (child->kind == YamlNode::Kind::scalar && child->scalar == "rigid")) {
      *child = {YamlNode::Kind::map};
    }
    if (child->kind != YamlNode::Kind::map) return nullptr;  // the reader says so
    node = child;
  }
  return node;
}

}  // namespace

JointParameters take_joint_parameters(YamlNode& root, const Scenario& scenario,
                                      const std::filesystem::path& directory) {
  YamlNode* const robot = root.find("robot");
  const YamlNode* const file = robot == nullptr ? nullptr : robot->find("joint_parameters");
  if (file == nullptr) return {};
  if (file->kind != YamlNode::Kind::scalar) {
    throw scenario.complaint(std::string(key), emit_line(*file) + "; allowed: a file");
  }
  const std::filesystem::path path = directory / file->scalar;
  JointParameters parameters;
  try {
    const std::string text = base::given_text(path, base::max_text_bytes);
    const std::size_t first = text.find_first_not_of(" \t\r\n\xef\xbb\xbf");
    const bool xml = first != std::string::npos && text[first] == '<';
    parameters = xml ? robot::read_mjcf_joints(text, path.string(), files_beside(path))
                     : read_yaml(text, path.string());
  } catch (const std::invalid_argument& refused) {
    throw scenario.complaint(std::string(key), refused.what());
  } catch (const base::Failure& refused) {
    throw scenario.complaint(std::string(key), refused.what());
  }
  if (parameters.empty()) {
    throw scenario.complaint(std::string(key), "{}: has no named joint; allowed: a file that has",
                             path.string());
  }
  const auto at = robot->keys.begin() +
                  (std::ranges::find(robot->keys, "joint_parameters") - robot->keys.begin());
  robot->children.erase(robot->children.begin() + (at - robot->keys.begin()));
  robot->keys.erase(at);
  return parameters;
}

void add_joint_parameters(YamlNode& root, Scenario& scenario, const JointParameters& parameters,
                          const robot::Model& model) {
  if (parameters.empty()) return;
  const bool flexible = scenario.gives("robot.joints.flexible");
  const std::string joints = flexible ? "flexible" : "rigid";
  const std::array<std::pair<std::vector<std::string>, double robot::JointNumbers::*>, 3> keys{
      {{{"robot", "joints", joints, "rotor_inertia_kgm2"}, &robot::JointNumbers::rotor_inertia},
       {{"plant", "drive", "viscous_friction_Nms_per_rad"}, &robot::JointNumbers::viscous_friction},
       {{"plant", "drive", "coulomb_friction_Nm"}, &robot::JointNumbers::coulomb_friction}}};
  for (const auto& [path, member] : keys) {
    const std::string name = fmt::format("{}", fmt::join(path, "."));
    if (scenario.gives(name)) continue;
    YamlNode* const map = map_at(root, {path.begin(), path.end() - 1});
    if (map == nullptr) continue;
    YamlNode list{YamlNode::Kind::list};
    for (const std::string& joint : model.joint_names) {
      const auto found = parameters.find(joint);
      if (found == parameters.end()) {
        std::vector<std::string_view> known;
        for (const auto& [each, numbers] : parameters) known.push_back(each);
        throw scenario.complaint(std::string(key),
                                 "it has no joint \"{}\", which the URDF has; its joints: {}",
                                 joint, base::joined(known));
      }
      list.children.push_back({YamlNode::Kind::scalar, base::shortest(found->second.*member)});
    }
    map->add(path.back()) = std::move(list);
    scenario.where[name] = fmt::format("{}: {}", scenario.where.at(std::string(key)), key);
  }
}

}  // namespace tachless::scenario
