#include "scenario/scenario.h"
#include "scenario/description.h"
#include "scenario/drive_loop.h"
#include "scenario/driver_settings.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>

#include "base/file_text.h"
#include "base/fnv.h"
#include "base/text.h"
#include "messages/measurements.h"
#include "robot/urdf_xml.h"
#include "scenario/joint_parameters.h"
#include "scenario/model_pin.h"
#include "scenario/motion_file.h"
#include "scenario/reader.h"
#include "scenario/xacro.h"
#include "scenario/yaml_tree.h"

namespace tachless::scenario {
namespace {

namespace fs = std::filesystem;
using base::consists_of;
using base::shortest;

// Both texts travel in one RUN_INFO datagram, which holds 65,499 bytes.
constexpr std::size_t max_message_bytes = 60'000;
constexpr double max_ticks = 1e9;

/// Remembers where every key was written.
void locate(const YamlNode& node, const std::string& path, Scenario& scenario) {
  for (std::size_t i = 0; i < node.children.size(); ++i) {
    const YamlNode& child = node.children[i];
    const bool map = node.kind == YamlNode::Kind::map;
    if (!map && child.kind != YamlNode::Kind::map) continue;
    const std::string child_path =
        map ? (path.empty() ? "" : path + ".") + node.keys[i] : fmt::format("{}[{}]", path, i);
    scenario.where[child_path] = child.where;
    locate(child, child_path, scenario);
  }
}

double nearest_num_ticks(const LoopSpec& loop) {
  return std::max(1.0, std::round(loop.duration_s / loop.period_s));
}

std::int64_t digest_of(std::string_view text, std::string_view urdf_text) {
  using base::fnv;
  return std::bit_cast<std::int64_t>(fnv(urdf_text, fnv(std::string_view("\0", 1), fnv(text))));
}

/// The tree with overrides applied; where its keys come from goes to `scenario`.
YamlNode located_tree(std::string_view text, const std::vector<std::string>& overrides,
                      Scenario& scenario) {
  if (const std::size_t first = text.find_first_not_of(" \t\r\n\xef\xbb\xbf");
      first != std::string_view::npos && text[first] == '<') {
    throw base::bad_usage("{}: {}; allowed here: a scenario", scenario.source,
                          robot::xml_kind(text, scenario.source));
  }
  YamlNode root = parse_yaml(text, scenario.source);
  if (root.kind != YamlNode::Kind::map) {
    if (root.kind == YamlNode::Kind::null) {
      throw base::bad_usage("{}:1: empty; allowed: a scenario", scenario.source);
    }
    throw base::bad_usage("{}: {}; allowed: a map of keys", root.where, emit_line(root));
  }
  for (const std::string& assignment : overrides) apply_override(root, assignment);
  locate(root, "", scenario);
  // Some keys of these maps are read before the others.
  const Place place{scenario, &root, ""};
  require_known_keys<Scenario>(place);
  require_known_keys<RobotSpec>(place.child("robot"));
  require_known_keys<controller::Spec>(place.child("controller"));
  return root;
}

/// A robot's URDF text with the name that messages have for it. Both are empty if none is given.
struct Description {
  std::string text, source;
  std::vector<std::string> warnings;  ///< of the file that the text was made of
  bool adds_gravity = false;          ///< an MJCF's bodies have gravcomp="1"
};

robot::UrdfOptions urdf_options(const RobotSpec& spec) {
  robot::UrdfOptions options;
  options.check_inertia = spec.check_inertia;
  options.locked = spec.locked;
  options.base_rpy = {spec.base.rpy[0], spec.base.rpy[1], spec.base.rpy[2]};
  options.base_xyz = {spec.base.xyz[0], spec.base.xyz[1], spec.base.xyz[2]};
  return options;
}

/// Reads the keys of `robot`, which is `place`, without which no URDF can be read.
robot::UrdfOptions read_urdf_options(const Place& place, RobotSpec& spec) {
  read_key(place.child("check_inertia"), RobotSpec::check_inertia_key, spec);
  read_key(place.child("locked"), RobotSpec::locked_key, spec);
  read_key(place.child("base"), RobotSpec::base_key, spec);
  return urdf_options(spec);
}

/// Reads the robot's file that is the value `written` of `key`. Returns nothing for an empty value.
Description read_robot_file(const Scenario& scenario, const std::string& key,
                            const std::string& written, const fs::path& directory) {
  if (written.empty()) return {};
  const fs::path path = directory / written;
  try {
    robot::Description read = read_description(path, scenario.robot.xacro);
    return {std::move(read.urdf), path.string(), std::move(read.warnings), read.adds_gravity};
  } catch (const base::Failure& failure) {
    throw scenario.complaint(key, failure.what());
  }
}

/// Returns the robot of a description, which is the value of `key`, and adds its mechanics
/// (robot::urdf_mechanics) to `mechanics`.
robot::Model described_robot(const Scenario& scenario, const std::string& key,
                             const Description& description, std::string& mechanics) {
  const robot::UrdfOptions options = urdf_options(scenario.robot);
  try {
    robot::UrdfTree tree =
        robot::read_urdf_xml(description.text, description.source, options.locked);
    mechanics += tree.mechanics;
    tree.warnings.insert(tree.warnings.begin(), description.warnings.begin(),
                         description.warnings.end());
    return robot::model_of(std::move(tree), description.source, options);
  } catch (const std::invalid_argument& error) {
    throw scenario.complaint(key, error.what());
  }
}

/// @param key of the scenario that names the URDF of `believed`
void require_same_joints(const Scenario& scenario, const std::string& key,
                         const robot::Model& model, const robot::Model& believed) {
  if (model.joint_names == believed.joint_names && model.joint_types == believed.joint_types)
    return;
  throw scenario.complaint(
      key, "its joints are {}; allowed: those of robot.urdf by name, type and order: {}",
      base::joined(believed.joint_names), base::joined(model.joint_names));
}

/// With the rotors of rigid joints, which may give a joint all the inertia it has.
void require_positive_inertia(const Scenario& scenario, const std::string& key, robot::Model model,
                              const std::string& source) {
  model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  try {
    robot::require_positive_inertia(model, source);
  } catch (const std::invalid_argument& error) {
    throw scenario.complaint(key, error.what());
  }
}

/// An arm that adds gravity holds itself before the first command. One that cancels friction has
/// the rest of it.
void apply_compensation(Scenario& scenario) {
  const CompensationSpec& arm = scenario.robot.compensates;
  plant::InitialTorque& initial = scenario.plant.initial.torque;
  if (arm.gravity && scenario.gives("plant.initial.torque") &&
      initial == plant::InitialTorque::zero) {
    throw scenario.complaint("plant.initial.torque",
                             "zero, but an arm that adds gravity itself "
                             "(robot.compensates.gravity) holds its initial posture; allowed: "
                             "hold");
  }
  if (arm.gravity) initial = plant::InitialTorque::hold;
  if (arm.friction == 0) return;
  plant::DriveSpec& drive = scenario.plant.drive;
  controller::FrictionSpec& known = scenario.controller.friction;
  for (Vector* friction :
       {&drive.viscous_friction_Nms_per_rad, &drive.coulomb_friction_Nm, &drive.friction_rise_Nm,
        &drive.load_friction, &known.viscous, &known.coulomb, &known.rise, &known.load}) {
    *friction *= 1 - arm.friction;
  }
  if (drive.static_friction_Nm) *drive.static_friction_Nm *= 1 - arm.friction;
}

/// Simbody refuses inertias that no body can have: without a choice the native mechanics take over.
void require_mechanics_for(robot::Model& model, Scenario& scenario) {
  if (robot::is_possible(model)) return;
  const std::string why = "refuses the inertias that robot.check_inertia lets pass";
  const bool chosen = scenario.gives("plant.mechanics");
  if (chosen && scenario.plant.mechanics == plant::Mechanics::simbody) {
    throw scenario.complaint("plant.mechanics", "simbody: it " + why + "; allowed: native");
  }
  scenario.plant.mechanics = plant::Mechanics::native;
  if (!chosen) model.warnings.emplace_back("plant.mechanics is native: simbody " + why);
}

/// Takes the rotor inertia of the URDF (<dynamics armature>) for rigid joints unless the scenario
/// gives it. The models themselves have none.
void take_rotors(Scenario& scenario, robot::Model& model, std::optional<robot::Model>& believed) {
  if (!scenario.robot.flexible && !scenario.gives("robot.joints.rigid.rotor_inertia_kgm2") &&
      model.rotor_inertia.any()) {
    scenario.robot.rigid_rotor_inertia_kgm2 = model.rotor_inertia;
  }
  model.rotor_inertia.setZero();
  if (believed) believed->rotor_inertia.setZero();
}

/// Takes the child `name` out of `map`; nothing without it.
std::optional<YamlNode> taken(YamlNode* map, std::string_view name) {
  if (map == nullptr || map->kind != YamlNode::Kind::map) return {};
  const auto key = std::ranges::find(map->keys, name);
  if (key == map->keys.end()) return {};
  const auto value = map->children.begin() + (key - map->keys.begin());
  YamlNode result = std::move(*value);
  map->children.erase(value);
  map->keys.erase(key);
  return result;
}

/// Takes `plant.driver` and `plant.drive.loop` out of the tree. The scenario's text keeps both: the
/// former for the driver that declares its keys, the latter for `drive_loop`.
void take_kept_as_text(YamlNode& root, const Scenario& scenario) {
  YamlNode* plant = root.find("plant");
  const std::optional<YamlNode> driver = taken(plant, "driver");
  if (driver && driver->kind != YamlNode::Kind::map) {
    throw scenario.complaint("plant.driver", emit_line(*driver) +
                                                 "; allowed: a map of the driver's "
                                                 "own keys");
  }
  taken(plant == nullptr ? nullptr : plant->find("drive"), "loop");
}

/// Takes the keys out of the tree that `read_urdf_options` has read.
void take_urdf_options(YamlNode& root) {
  for (const std::string_view name :
       {RobotSpec::check_inertia_key.name, RobotSpec::locked_key.name, RobotSpec::base_key.name}) {
    taken(root.find("robot"), name);
  }
}

Scenario read_scenario(YamlNode root, const Description& plant, const Description& believed,
                       const JointParameters& parameters, Scenario scenario) {
  read_urdf_options(Place{scenario, &root, ""}.child("robot"), scenario.robot);
  std::string& mechanics = scenario.robot.urdf_text;
  robot::Model model = described_robot(scenario, "robot.urdf", plant, mechanics);
  add_joint_parameters(root, scenario, parameters, model);
  scenario.text = emit_yaml(root);
  std::optional<robot::Model> believed_model;
  if (!believed.source.empty()) {
    believed_model = described_robot(scenario, "controller.urdf", believed, mechanics);
    require_same_joints(scenario, "controller.urdf", model, *believed_model);
  }
  scenario.digest = digest_of(scenario.text, mechanics);
  if (scenario.text.size() + mechanics.size() > max_message_bytes) {
    throw scenario.complaint(
        "robot.urdf",
        "scenario ({} bytes) and the URDF's joints and inertials ({} bytes) must fit one message; "
        "allowed: {} bytes in all; shorten names, numbers or the reference",
        scenario.text.size(), mechanics.size(), max_message_bytes);
  }
  scenario.num_joints = model.num_joints;
  take_kept_as_text(root, scenario);
  take_urdf_options(root);
  read(Place{scenario, &root, ""}, scenario);
  take_rotors(scenario, model, believed_model);

  model.gravity = {0, 0, -scenario.robot.gravity_m_per_s2};
  if (!scenario.gives("plant.drive.torque_limit_Nm") &&
      model.effort_limit.array().isFinite().any()) {
    scenario.plant.drive.torque_limit_Nm = model.effort_limit;
  }
  if (!scenario.gives("plant.drive.coulomb_friction_Nm")) {
    scenario.plant.drive.coulomb_friction_Nm = model.friction;
  }
  require_positive_inertia(scenario, "robot.urdf", model, plant.source);
  require_mechanics_for(model, scenario);
  if (!scenario.gives("plant.drive.viscous_friction_Nms_per_rad")) {
    scenario.plant.drive.viscous_friction_Nms_per_rad = model.damping;
  }
  apply_compensation(scenario);
  scenario.model = std::make_shared<const robot::Model>(std::move(model));
  if (believed_model) {
    require_positive_inertia(scenario, "controller.urdf", *believed_model, believed.source);
    scenario.believed_model = std::make_shared<const robot::Model>(std::move(*believed_model));
  }
  scenario.robot.channel_prefix = messages::channel_prefix(scenario.robot.name);
  scenario.loop.num_ticks = static_cast<std::int64_t>(nearest_num_ticks(scenario.loop));
  require_consistent(scenario);
  drive_loop(scenario);  // refuses what is wrong in it
  return scenario;
}

}  // namespace

void RobotSpec::set_joints(Joints given) {
  if (auto* rigid = std::get_if<plant::RigidJoints>(&given)) {
    rigid_rotor_inertia_kgm2 = std::move(rigid->rotor_inertia);
  } else {
    flexible = std::get<plant::FlexibleDrive>(std::move(given));
    rigid_rotor_inertia_kgm2 = Vector::Zero(flexible->stiffness.size());
  }
}

std::optional<base::Refusal> BaseSpec::refusal() const {
  for (const auto& [name, value] : {std::pair{"rpy", &rpy}, std::pair{"xyz", &xyz}}) {
    if (value->size() == 3) continue;
    return base::Refusal{name, fmt::format("{} numbers; allowed: 3", value->size())};
  }
  return std::nullopt;
}

std::string CompensationSpec::text() const {
  std::vector<std::string> terms;
  if (gravity) terms.emplace_back("gravity");
  if (coriolis) terms.emplace_back("Coriolis torque");
  if (friction == 1) terms.emplace_back("friction");
  if (friction > 0 && friction < 1) terms.push_back(shortest(friction) + " of the friction");
  return terms.empty() ? "nothing" : base::joined(terms, " and ");
}

std::optional<base::Refusal> CompensationSpec::refusal() const {
  if (!base_rpy.empty() && base_rpy.size() != 3) {
    return base::Refusal{"base_rpy", fmt::format("{} numbers; allowed: 3", base_rpy.size())};
  }
  if (!base_rpy.empty() && !gravity) {
    return base::Refusal{"base_rpy",
                         "given, but the arm adds no gravity; allowed: with gravity: true"};
  }
  if (!urdf_path.empty() && !adds_torque()) {
    return base::Refusal{
        "urdf",
        "given, but the arm adds no torque of a model; allowed: with gravity: true or "
        "coriolis: true"};
  }
  return std::nullopt;
}

std::optional<base::Refusal> RobotSpec::refusal() const {
  if (!consists_of(name, "_") || name.size() > 32) {
    return base::Refusal{
        "name", fmt::format("\"{}\"; allowed: letters, digits and _, at most 32 of them", name)};
  }
  if ((joint_signs.array() == 0).any()) {
    return base::Refusal{"joint_signs", "0; allowed: 1 and -1"};
  }
  return std::nullopt;
}

std::optional<base::Refusal> LoopSpec::refusal() const {
  const double ticks = duration_s / period_s;
  if (ticks > max_ticks) {
    return base::Refusal{"duration_s",
                         fmt::format("{:.6g} ticks of {} s; allowed: at most {:.6g} ticks", ticks,
                                     shortest(period_s), max_ticks)};
  }
  constexpr double tolerance_ticks = 1e-6;
  const double whole = nearest_num_ticks(*this);
  const auto is_whole = [&](double duration) {
    return std::abs(duration / period_s - whole) <= tolerance_ticks;
  };
  if (is_whole(duration_s)) return std::nullopt;
  const auto nearest = [&](int digits) { return fmt::format("{:.{}g}", whole * period_s, digits); };
  int digits = 6;
  while (digits < 17 && !is_whole(std::stod(nearest(digits)))) ++digits;
  return base::Refusal{
      "duration_s",
      fmt::format("{} is {:.9g} periods of {} s; allowed: a whole number of periods, nearest is {}",
                  shortest(duration_s), ticks, shortest(period_s), nearest(digits))};
}

std::optional<base::Refusal> Scenario::refusal() const {
  if (consists_of(name, "._-") && name.size() <= 100 && name.front() != '.' &&
      name.front() != '-') {
    return std::nullopt;
  }
  return base::Refusal{
      "name",
      fmt::format(
          "\"{}\"; allowed: letters, digits, ., _ and -, not . or - first, at most 100 of them",
          name)};
}

void Scenario::require_law(const messages::LawInfo& law) const {
  if (controller.law != controller::external_law_name && law.law != controller.law) {
    throw complaint(
        "controller.law",
        "{}, but the controller runs the law \"{}\"; for a law of your own, write law: {}",
        controller.law, law.law, controller::external_law_name);
  }
  if (!controller.measurement.empty() && law.measurement != controller.measurement) {
    throw complaint("controller.measurement", "{}, but the controller needs \"{}\"",
                    controller.measurement, law.measurement);
  }
}

base::Failure Scenario::complaint(const std::string& key, std::string_view problem) const {
  std::string_view place = source;
  for (std::string part = key; !part.empty();) {
    if (const auto found = where.find(part); found != where.end()) {
      place = found->second;
      break;
    }
    const std::size_t cut = part.find_last_of(".[");
    part.resize(cut == std::string::npos ? 0 : cut);
  }
  return base::bad_usage("{}: {}: {}", place, key, problem);
}

Scenario load_scenario(const fs::path& path, const std::vector<std::string>& overrides) {
  Scenario scenario;
  scenario.source = path.string();
  YamlNode root = located_tree(base::given_text(path, base::max_text_bytes), overrides, scenario);
  const fs::path directory = path.parent_path();
  pin_motion(root, scenario, directory);
  pin_model(root, scenario, directory);
  const JointParameters parameters = take_joint_parameters(root, scenario, directory);
  const Place place{scenario, &root, ""};
  read_key(place.child("robot").child("urdf"), RobotSpec::urdf_key, scenario.robot);
  read_key(place.child("robot").child("xacro"), RobotSpec::xacro_key, scenario.robot);
  read_key(place.child("controller").child("urdf"), controller::Spec::urdf_key,
           scenario.controller);
  const Description plant =
      read_robot_file(scenario, "robot.urdf", scenario.robot.urdf_path, directory);
  const Description believed =
      read_robot_file(scenario, "controller.urdf", scenario.controller.urdf_path, directory);
  Scenario read = read_scenario(std::move(root), plant, believed, parameters, std::move(scenario));
  read_motion(read, directory);
  if (plant.adds_gravity && !read.gives("robot.compensates.gravity")) {
    throw read.complaint("robot.urdf",
                         "{}: each body that moves has gravcomp=\"1\", an arm that carries its own "
                         "weight; give robot.compensates: {{gravity: true}}, or {{gravity: false}} "
                         "for an arm that does not",
                         plant.source);
  }
  return read;
}

Scenario parse_scenario(std::string_view text, std::string_view urdf_text,
                        const std::string& source, const std::vector<std::string>& overrides,
                        const std::optional<fs::path>& folder) {
  Scenario scenario;
  scenario.source = source;
  YamlNode root = located_tree(text, overrides, scenario);
  Description plant{std::string(urdf_text), source + " (URDF)", {}}, believed;
  const auto refusal = [&](const std::string& key) {
    return scenario.complaint(key, "its file is not read here; allowed: in a scenario's file");
  };
  JointParameters parameters;
  if (folder) {
    parameters = take_joint_parameters(root, scenario, *folder);
  } else if (scenario.gives("robot.joint_parameters")) {
    throw refusal("robot.joint_parameters");
  }
  if (scenario.gives("controller.urdf")) {
    // The text of one robot ends where the other's begins.
    constexpr std::string_view end = "</robot>";
    const std::size_t cut = urdf_text.find(end);
    if (scenario.where.at("controller.urdf").starts_with("--set ") ||
        cut == std::string_view::npos || urdf_text.find("<robot", cut) == std::string_view::npos) {
      throw refusal("controller.urdf");
    }
    believed = {plant.text.substr(cut + end.size()), plant.source, {}};
    plant.text.resize(cut + end.size());
  }
  return read_scenario(std::move(root), plant, believed, parameters, std::move(scenario));
}

YamlNode driver_node(const Scenario& scenario) {
  YamlNode root = parse_yaml(scenario.text, scenario.source);
  return taken(root.find("plant"), "driver").value_or(YamlNode());
}

std::optional<DriveLoopSpec> drive_loop(const Scenario& scenario) {
  const std::string key = "plant.drive.loop";
  if (!scenario.gives(key)) return {};
  YamlNode root = parse_yaml(scenario.text, scenario.source);
  YamlNode* plant = root.find("plant");
  const std::optional<YamlNode> node =
      taken(plant == nullptr ? nullptr : plant->find("drive"), "loop");
  if (!node) return {};
  DriveLoopSpec loop;
  read(Place{scenario, &*node, key}, loop);
  if (scenario.robot.flexible) {
    throw scenario.complaint(key,
                             "given, but the robot's joints are flexible; allowed: rigid ones");
  }
  const double ticks = scenario.loop.period_s / loop.period_s;
  constexpr double rounding = 1e-6;
  if (std::abs(ticks - std::round(ticks)) > rounding || ticks < 1 - rounding) {
    throw scenario.complaint(key + ".period_s",
                             "{}; loop.period_s ({}) is {:.6g} times that; allowed: a whole "
                             "number of times",
                             shortest(loop.period_s), shortest(scenario.loop.period_s), ticks);
  }
  if (loop.late_ticks > std::lround(ticks) - 1) {
    throw scenario.complaint(key + ".late_ticks",
                             "{}; loop.period_s has {:.0f} ticks of the drives; allowed: "
                             "fewer; raise loop.command_delay",
                             loop.late_ticks, ticks);
  }
  return loop;
}

Vector drive_count(const Scenario& scenario, const DriveLoopSpec& loop, const robot::Model& model) {
  Scenario drives = scenario;
  drives.plant.encoder.resolution_bits = loop.resolution_bits;
  return encoder_count(drives, model);
}

void require_no_drive_loop(const Scenario& scenario, std::string_view why) {
  if (!scenario.gives("plant.drive.loop")) return;
  throw scenario.complaint("plant.drive.loop", "given; {}; allowed: without the key", why);
}

robot::Model own_model(const Scenario& scenario) {
  const RobotSpec& robot = scenario.robot;
  const CompensationSpec& arm = robot.compensates;
  robot::Model model = *scenario.model;
  if (!arm.urdf_path.empty()) {
    const std::string key = "robot.compensates.urdf";
    std::string mechanics;
    model = described_robot(
        scenario, key,
        read_robot_file(scenario, key, arm.urdf_path, fs::path(scenario.source).parent_path()),
        mechanics);
    require_same_joints(scenario, key, *scenario.model, model);
    model.gravity = scenario.model->gravity;
  }
  if (!arm.base_rpy.empty()) {
    // Gravity in the root link's axes is what its own model takes it for.
    const auto rotation = [](const std::vector<double>& rpy) {
      return robot::rotation_of({rpy[0], rpy[1], rpy[2]});
    };
    model.gravity = rotation(robot.base.rpy) * rotation(arm.base_rpy).transpose() * model.gravity;
  }
  return model;
}

RobotFile robot_file(const fs::path& file, const std::vector<std::string>& overrides) {
  std::vector<std::string> applied = overrides;
  std::erase_if(applied, [](const std::string& each) { return !each.starts_with("robot"); });
  Scenario scenario;
  const YamlNode root = located_tree("robot: {}", applied, scenario);
  const Place place = Place{scenario, &root, ""}.child("robot");
  read_key(place.child("xacro"), RobotSpec::xacro_key, scenario.robot);
  RobotFile read{read_description(file, scenario.robot.xacro), {}};
  read.options = read_urdf_options(place, scenario.robot);
  return read;
}

}  // namespace tachless::scenario
