#include "experiment/scenario.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <numbers>
#include <stdexcept>

#include "diagnostics/text.h"
#include "experiment/reader.h"
#include "experiment/scenario_keys.h"
#include "experiment/yaml_tree.h"
#include "robot/positive_inertia.h"

namespace tachless::experiment {
namespace {

using diagnostics::shortest;

constexpr std::size_t max_file_bytes = 1'000'000;
// Both texts travel in one RUN_INFO datagram, which holds 65,499 bytes.
constexpr std::size_t max_message_bytes = 60'000;
constexpr double max_ticks = 1e9;

bool consists_of(std::string_view text, std::string_view extra, bool capitals = true) {
  return std::all_of(text.begin(), text.end(), [&](char c) {
    return (c >= 'a' && c <= 'z') || (capitals && c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           extra.find(c) != std::string_view::npos;
  });
}

/// Remembers where every key was written and refuses the ones that do not exist.
void survey(const YamlNode& root, const YamlNode& node, const std::string& path,
            Scenario& scenario) {
  for (std::size_t i = 0; i < node.children.size(); ++i) {
    const YamlNode& child = node.children[i];
    const bool map = node.kind == YamlNode::Kind::map;
    const std::string child_path =
        map ? (path.empty() ? "" : path + ".") + node.keys[i] : fmt::format("{}[{}]", path, i);
    if (child.set_by.empty()) {
      scenario.line[child_path] = child.line;
    } else {
      scenario.set_by[child_path] = child.set_by;
    }
    if (!is_scenario_key(child_path)) {
      const YamlNode* const controller = root.find("controller");
      const YamlNode* const gains = controller == nullptr ? nullptr : controller->find("gains");
      throw scenario.complaint(
          child_path,
          "unknown; " + known_keys_hint(child_path, gains == nullptr ? std::vector<std::string>{}
                                                                     : gains->keys));
    }
    if (has_keys_below(child_path)) survey(root, child, child_path, scenario);
  }
}

void require_possible_initial_state(const Scenario& scenario) {
  const robot::Vector& position = scenario.plant.initial.position_rad;
  const robot::Model& model = *scenario.model;
  for (int i = 0; i < scenario.num_joints; ++i) {
    if (position[i] >= model.lower[i] && position[i] <= model.upper[i]) continue;
    const auto joint = static_cast<std::size_t>(i);
    const bool degrees = model.joint_types[joint] == robot::JointType::revolute &&
                         std::abs(position[i]) > 2 * std::numbers::pi;
    throw scenario.complaint(
        "plant.initial.position_rad",
        fmt::format("{} of joint {} is outside its limits in the URDF; allowed: in [{}, {}]{}",
                    shortest(position[i]), model.joint_names[joint], shortest(model.lower[i]),
                    shortest(model.upper[i]),
                    degrees ? "; angles are in rad, were degrees given?" : ""));
  }
}

/// What only flexible joints have is refused on a rigid robot.
void require_motors_only_behind_springs(const Scenario& scenario) {
  if (scenario.robot.flexible) return;
  for (const char* key :
       {"plant.initial.motor_position_rad", "plant.initial.motor_velocity_rad_per_s"}) {
    if (!scenario.gives(key)) continue;
    throw scenario.complaint(key,
                             "the robot has rigid joints; allowed: only with robot.joints: "
                             "{flexible: …}");
  }
  if (scenario.plant.encoder.side == plant::EncoderSide::motor) {
    throw scenario.complaint("plant.encoder.side",
                             "motor: the robot has rigid joints; allowed: link, both, or "
                             "robot.joints: {flexible: …}");
  }
}

void require_payload_link(const Scenario& scenario) {
  const plant::PayloadSpec& payload = scenario.plant.payload;
  const robot::Model& model = *scenario.model;
  if (!payload.link.empty() && model.frames.count(payload.link) == 0) {
    std::vector<std::string_view> links;
    for (const auto& [link, frame] : model.frames) links.push_back(link);
    throw scenario.complaint("plant.payload.link",
                             fmt::format("\"{}\" is not in the URDF; allowed: {}", payload.link,
                                         diagnostics::joined(links)));
  }
  if (payload.mass_kg == 0) return;
  try {
    robot::with_payload(model, payload.mass_kg, payload.link);
  } catch (const std::invalid_argument& error) {
    throw scenario.complaint("plant.payload.link", error.what());
  }
}

double nearest_num_ticks(const LoopSpec& loop) {
  return std::max(1.0, std::round(loop.duration_s / loop.period_s));
}

/// FNV-1a, 64 bits.
std::int64_t digest_of(std::string_view text, std::string_view urdf_text) {
  std::uint64_t hash = 0xcbf29ce484222325;
  const auto add = [&](char c) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3;
  };
  for (const char c : text) add(c);
  add('\0');
  for (const char c : urdf_text) add(c);
  return std::bit_cast<std::int64_t>(hash);
}

/// The tree with overrides applied and no unknown key; where its keys come from goes to `scenario`.
YamlNode surveyed_tree(std::string_view text, const std::vector<std::string>& overrides,
                       Scenario& scenario) {
  YamlNode root = parse_yaml(text, scenario.source);
  if (root.kind == YamlNode::Kind::null) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               scenario.source + ":1: empty; allowed: a scenario");
  }
  if (root.kind != YamlNode::Kind::map) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               scenario.source + ":" + std::to_string(root.line) + ": " +
                                   emit_line(root) + "; allowed: a map of keys");
  }
  for (const std::string& assignment : overrides) apply_override(root, assignment);
  survey(root, root, "", scenario);
  return root;
}

/// From the keys of `place`, which is `robot`.
robot::UrdfOptions read_urdf_options(const Place& place, RobotSpec& spec) {
  read_key(place.child("check_inertia"), RobotSpec::check_inertia_key, spec);
  read_key(place.child("locked"), RobotSpec::locked_key, spec);
  read_key(place.child("base"), RobotSpec::base_key, spec);
  robot::UrdfOptions options;
  options.check_inertia = spec.check_inertia;
  options.locked = spec.locked;
  options.base_rpy = {spec.base.rpy[0], spec.base.rpy[1], spec.base.rpy[2]};
  options.base_xyz = {spec.base.xyz[0], spec.base.xyz[1], spec.base.xyz[2]};
  return options;
}

/// The robot of `urdf_text`, read with the keys of `place`, which is `robot`; what there is to say
/// of the file is of `robot.urdf`.
robot::Model read_robot(const Place& place, std::string_view urdf_text, const std::string& source,
                        Scenario& scenario) {
  const robot::UrdfOptions options = read_urdf_options(place, scenario.robot);
  try {
    scenario.robot.urdf_text = robot::urdf_mechanics(std::string(urdf_text), source);
    return robot::read_urdf(std::string(urdf_text), source, options);
  } catch (const std::invalid_argument& error) {
    throw scenario.complaint("robot.urdf", error.what());
  }
}

/// With the rotors of rigid joints, which may give a joint all the inertia it has.
void require_positive_inertia(const Scenario& scenario, robot::Model model,
                              const std::string& source) {
  model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  try {
    robot::require_positive_inertia(model, source);
  } catch (const std::invalid_argument& error) {
    throw scenario.complaint("robot.urdf", error.what());
  }
}

/// Simbody refuses inertias that no body can have: without a choice the native mechanics take them.
void require_mechanics_for(robot::Model& model, Scenario& scenario) {
  if (robot::is_possible(model)) return;
  if (scenario.gives("plant.mechanics") && scenario.plant.mechanics == plant::Mechanics::simbody) {
    throw scenario.complaint("plant.mechanics",
                             "simbody: it refuses the inertias that robot.check_inertia lets pass; "
                             "allowed: native");
  }
  scenario.plant.mechanics = plant::Mechanics::native;
  if (const auto refused = scenario.plant.refusal()) {
    throw scenario.complaint("plant." + refused->key, refused->problem);
  }
  model.warnings.emplace_back(
      "plant.mechanics is native, as Simbody refuses the inertias that robot.check_inertia lets "
      "pass");
}

Scenario read_scenario(const YamlNode& root, std::string_view urdf_text,
                       const std::string& urdf_source, Scenario scenario) {
  scenario.text = emit_yaml(root);
  robot::Model model =
      read_robot(Place{scenario, &root, ""}.child("robot"), urdf_text, urdf_source, scenario);
  const std::string& mechanics = scenario.robot.urdf_text;
  scenario.digest = digest_of(scenario.text, mechanics);
  if (scenario.text.size() + mechanics.size() > max_message_bytes) {
    throw scenario.complaint(
        "robot.urdf",
        fmt::format("scenario ({} bytes) and the URDF's joints and inertials ({} bytes) must fit "
                    "one message; allowed: {} bytes in all; shorten names, numbers or the "
                    "reference",
                    scenario.text.size(), mechanics.size(), max_message_bytes));
  }
  scenario.num_joints = model.num_joints;
  read(Place{scenario, &root, ""}, scenario);

  model.gravity = {0, 0, -scenario.robot.gravity_m_per_s2};
  if (!scenario.gives("plant.drive.torque_limit_Nm") &&
      model.effort_limit.array().isFinite().any()) {
    scenario.plant.drive.torque_limit_Nm = model.effort_limit;
  }
  require_positive_inertia(scenario, model, urdf_source);
  require_mechanics_for(model, scenario);
  if (!scenario.gives("plant.drive.viscous_friction_Nms_per_rad")) {
    scenario.plant.drive.viscous_friction_Nms_per_rad = model.damping;
  }
  scenario.model = std::make_shared<const robot::Model>(std::move(model));
  scenario.robot.channel_prefix = scenario.robot.name;
  for (char& c : scenario.robot.channel_prefix) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  }
  scenario.loop.num_ticks = static_cast<std::int64_t>(nearest_num_ticks(scenario.loop));
  require_possible_initial_state(scenario);
  require_motors_only_behind_springs(scenario);
  require_payload_link(scenario);
  return scenario;
}

/// The file's text. @throw std::runtime_error with what is wrong, without the file's name.
std::string text_of(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    throw std::runtime_error("no such file");
  if (status.type() == std::filesystem::file_type::directory) {
    throw std::runtime_error("is a directory; allowed: a file");
  }
  // It is read by each program of the run, and a pipe would be waited for.
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw std::runtime_error("is a pipe or a device; allowed: a file");
  }
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    const int cause = errno;
    throw std::runtime_error(fmt::format("cannot be read: {}; {}", std::strerror(cause),
                                         cause == EMFILE || cause == ENFILE
                                             ? "allow more open files, for example: ulimit -n 1024"
                                             : "see its permissions"));
  }
  std::string text(max_file_bytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (file.bad()) throw std::runtime_error("cannot be read");
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > max_file_bytes) {
    throw std::runtime_error(fmt::format("too large; allowed: at most {} bytes", max_file_bytes));
  }
  return text;
}

}  // namespace

void RobotSpec::set_joints(Joints given) {
  if (auto* rigid = std::get_if<plant::RigidJoints>(&given)) {
    rigid_rotor_inertia_kgm2 = std::move(rigid->rotor_inertia);
  } else {
    flexible = std::get<plant::FlexibleDrive>(std::move(given));
    rigid_rotor_inertia_kgm2 = robot::Vector::Zero(flexible->stiffness.size());
  }
}

std::optional<schema::Refusal> BaseSpec::refusal() const {
  for (const auto& [name, value] : {std::pair{"rpy", &rpy}, std::pair{"xyz", &xyz}}) {
    if (value->size() == 3) continue;
    return schema::Refusal{name, fmt::format("{} numbers; allowed: 3", value->size())};
  }
  return std::nullopt;
}

std::optional<schema::Refusal> RobotSpec::refusal() const {
  if (consists_of(name, "_") && name.size() <= 32) return std::nullopt;
  return schema::Refusal{
      "name", fmt::format("\"{}\"; allowed: letters, digits and _, at most 32 of them", name)};
}

std::optional<schema::Refusal> ControllerSpec::refusal() const {
  if (!consists_of(law, "_", false)) {
    return schema::Refusal{"law",
                           fmt::format("\"{}\"; allowed: lower-case letters, digits and _", law)};
  }
  for (const auto& [gain, value] : gains) {
    if (consists_of(gain, "_")) continue;
    return schema::Refusal{"gains." + gain, "not a gain's name; allowed: letters, digits and _"};
  }
  return std::nullopt;
}

std::optional<schema::Refusal> LoopSpec::refusal() const {
  const double ticks = duration_s / period_s;
  if (ticks > max_ticks) {
    return schema::Refusal{"duration_s",
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
  return schema::Refusal{
      "duration_s",
      fmt::format("{} is {:.9g} periods of {} s; allowed: a whole number of periods, nearest is {}",
                  shortest(duration_s), ticks, shortest(period_s), nearest(digits))};
}

std::optional<schema::Refusal> Scenario::refusal() const {
  if (consists_of(name, "._-") && name.size() <= 100 && name.front() != '.' &&
      name.front() != '-') {
    return std::nullopt;
  }
  return schema::Refusal{
      "name", fmt::format("\"{}\"; allowed: letters, digits, ., _ and -, not . or - first, at most "
                          "100 of them",
                          name)};
}

diagnostics::Failure Scenario::complaint(const std::string& key, const std::string& problem) const {
  std::string where = source;
  for (std::string part = key; !part.empty();) {
    if (const auto found = set_by.find(part); found != set_by.end()) {
      where = "--set " + found->second;
      break;
    }
    if (const auto found = line.find(part); found != line.end()) {
      where = source + ":" + std::to_string(found->second);
      break;
    }
    const std::size_t cut = part.find_last_of(".[");
    part = cut == std::string::npos ? "" : part.substr(0, cut);
  }
  return diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                              where + ": " + key + ": " + problem);
}

Scenario load_scenario(const std::filesystem::path& path,
                       const std::vector<std::string>& overrides) {
  Scenario scenario;
  scenario.source = path.string();
  std::string text;
  try {
    text = text_of(path);
  } catch (const std::runtime_error& error) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               path.string() + ": " + error.what());
  }
  const YamlNode root = surveyed_tree(text, overrides, scenario);
  const Place urdf = Place{scenario, &root, ""}.child("robot").child("urdf");
  read_key(urdf, RobotSpec::urdf_key, scenario.robot);
  const std::filesystem::path urdf_path = path.parent_path() / scenario.robot.urdf_path;
  std::string urdf_text;
  try {
    urdf_text = text_of(urdf_path);
  } catch (const std::runtime_error& error) {
    throw scenario.complaint("robot.urdf", urdf_path.string() + ": " + error.what());
  }
  return read_scenario(root, urdf_text, urdf_path.string(), std::move(scenario));
}

Scenario parse_scenario(std::string_view text, std::string_view urdf_text,
                        const std::string& source, const std::vector<std::string>& overrides) {
  Scenario scenario;
  scenario.source = source;
  const YamlNode root = surveyed_tree(text, overrides, scenario);
  return read_scenario(root, urdf_text, source + " (URDF)", std::move(scenario));
}

robot::UrdfOptions urdf_options(const std::vector<std::string>& overrides) {
  std::vector<std::string> of_robot;
  std::copy_if(overrides.begin(), overrides.end(), std::back_inserter(of_robot),
               [](const std::string& each) { return each.rfind("robot", 0) == 0; });
  Scenario scenario;
  const YamlNode root = surveyed_tree("robot: {}", of_robot, scenario);
  return read_urdf_options(Place{scenario, &root, ""}.child("robot"), scenario.robot);
}

robot::Vector encoder_count(const Scenario& scenario, const robot::Model& model) {
  robot::Vector count = robot::Vector::Zero(model.num_joints);
  const std::optional<int>& bits = scenario.plant.encoder.resolution_bits;
  if (!bits) return count;
  for (int i = 0; i < model.num_joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    const bool prismatic = model.joint_types[joint] == robot::JointType::prismatic;
    const double range = prismatic ? model.upper[i] - model.lower[i] : 2 * std::numbers::pi;
    if (!(std::isfinite(range) && range > 0)) {
      throw scenario.complaint(
          "plant.encoder.resolution_bits",
          fmt::format("{} needs a range to count over, but prismatic joint \"{}\" has no lower and "
                      "upper limit in the URDF; add them, or use null (ideal)",
                      *bits, model.joint_names[joint]));
    }
    count[i] = std::ldexp(range, -*bits);
  }
  return count;
}

}  // namespace tachless::experiment
