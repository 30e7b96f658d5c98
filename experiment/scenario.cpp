#include "experiment/scenario.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <stdexcept>

#include "experiment/scenario_keys.h"
#include "experiment/yaml_tree.h"
#include "robot/model.h"

namespace tachless::experiment {
namespace {

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

std::string in_quotes(std::string_view text) { return "\"" + std::string(text) + "\""; }

std::string shown(double value, int digits) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

/// As few digits as give the value back.
std::string shown(double value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

/// A map of the scenario, seen through the table of keys.
class Section {
 public:
  /// `node` may be null: the map is absent and every key has its default.
  Section(const Scenario& scenario, const YamlNode* node, std::string path)
      : scenario_(&scenario), node_(node), path_(std::move(path)) {
    if (node_ != nullptr && node_->kind != YamlNode::Kind::map) {
      throw scenario.complaint(path_, emit_line(*node_) + "; allowed: a map");
    }
  }

  [[nodiscard]] std::string path(const std::string& name) const {
    return path_.empty() ? name : path_ + "." + name;
  }
  [[nodiscard]] const YamlNode* find(const std::string& name) const {
    return node_ == nullptr ? nullptr : node_->find(name);
  }
  [[nodiscard]] Section section(const std::string& name) const {
    return {*scenario_, find(name), path(name)};
  }

  [[nodiscard]] diagnostics::Failure complaint(const std::string& name,
                                               const std::string& problem) const {
    return scenario_->complaint(path(name), problem);
  }
  /// "<value>[: <why>]; allowed: <what the table says>"
  [[nodiscard]] diagnostics::Failure refusal(const std::string& name,
                                             const std::string& problem) const {
    return complaint(name, problem + "; allowed: " + allowed_text(scenario_key(path(name))));
  }

  /// The value, or the table's default.
  [[nodiscard]] YamlNode value(const std::string& name) const {
    if (const YamlNode* found = find(name)) return *found;
    const Key& key = scenario_key(path(name));
    if (key.fallback.empty()) {
      throw complaint(name, "missing; allowed: " + allowed_text(key));
    }
    return parse_yaml(key.fallback, "default of " + path(name));
  }

  [[nodiscard]] std::string text(const std::string& name) const {
    const YamlNode node = value(name);
    if (node.kind != YamlNode::Kind::scalar || node.scalar.empty()) {
      throw refusal(name, emit_line(node));
    }
    return node.scalar;
  }

  template <class Enum>
  [[nodiscard]] Enum choice(const std::string& name) const {
    const std::string chosen = text(name);
    const auto& choices = scenario_key(path(name)).choices;
    const auto found = std::find(choices.begin(), choices.end(), chosen);
    if (found == choices.end()) throw refusal(name, chosen);
    return static_cast<Enum>(found - choices.begin());
  }

  [[nodiscard]] double number(const std::string& name) const {
    const YamlNode node = value(name);
    return number_from(name, node, emit_line(node));
  }

  [[nodiscard]] std::int64_t whole(const std::string& name) const {
    const YamlNode node = value(name);
    std::int64_t number = 0;
    const char* const end = node.scalar.data() + node.scalar.size();
    const auto [stop, error] = std::from_chars(node.scalar.data(), end, number);
    if (node.kind != YamlNode::Kind::scalar || node.quoted || error != std::errc{} || stop != end ||
        !scenario_key(path(name)).range.contains(static_cast<double>(number))) {
      throw refusal(name, emit_line(node));
    }
    return number;
  }

  [[nodiscard]] robot::Vector joints(const std::string& name) const {
    return joints_from(name, value(name), "");
  }

  [[nodiscard]] std::vector<double> numbers(const std::string& name) const {
    const YamlNode list = list_of(name);
    std::vector<double> numbers;
    for (const YamlNode& item : list.children) {
      numbers.push_back(number_from(name, item, entry(list, numbers.size())));
    }
    return numbers;
  }

  [[nodiscard]] std::vector<robot::Vector> joints_list(const std::string& name) const {
    const YamlNode list = list_of(name);
    std::vector<robot::Vector> vectors;
    for (const YamlNode& item : list.children) {
      vectors.push_back(joints_from(name, item, entry(list, vectors.size()) + ": "));
    }
    return vectors;
  }

  /// One section per entry of a list of maps.
  [[nodiscard]] std::vector<Section> sections(const std::string& name) const {
    const YamlNode* list = find(name);
    if (list == nullptr) throw refusal(name, "missing");
    if (list->kind != YamlNode::Kind::list || list->children.empty()) {
      throw refusal(name, emit_line(*list));
    }
    std::vector<Section> sections;
    for (const YamlNode& item : list->children) {
      sections.emplace_back(*scenario_, &item,
                            path(name) + "[" + std::to_string(sections.size()) + "]");
    }
    return sections;
  }

 private:
  static std::string entry(const YamlNode& list, std::size_t i) {
    return "entry " + std::to_string(i + 1) + " of " + emit_line(list) + " is " +
           emit_line(list.children[i]);
  }

  [[nodiscard]] YamlNode list_of(const std::string& name) const {
    YamlNode list = value(name);
    if (list.kind != YamlNode::Kind::list) throw refusal(name, emit_line(list));
    return list;
  }

  [[nodiscard]] double number_from(const std::string& name, const YamlNode& node,
                                   const std::string& what) const {
    double number = 0;
    const char* begin = node.scalar.data();
    const char* const end = begin + node.scalar.size();
    if (begin != end && *begin == '+') ++begin;
    const auto [stop, error] = std::from_chars(begin, end, number);
    if (node.kind != YamlNode::Kind::scalar || node.quoted || error != std::errc{} || stop != end ||
        !scenario_key(path(name)).range.contains(number)) {
      throw refusal(name, what);
    }
    return number;
  }

  [[nodiscard]] robot::Vector joints_from(const std::string& name, const YamlNode& node,
                                          const std::string& what) const {
    const int num_joints = scenario_->num_joints;
    if (node.kind != YamlNode::Kind::list) {
      return robot::Vector::Constant(num_joints, number_from(name, node, what + emit_line(node)));
    }
    if (static_cast<int>(node.children.size()) != num_joints) {
      throw refusal(name, what + emit_line(node) + " has length " +
                              std::to_string(node.children.size()) + ", the robot has " +
                              std::to_string(num_joints) + " joints");
    }
    robot::Vector vector(num_joints);
    for (int i = 0; i < num_joints; ++i) {
      const auto index = static_cast<std::size_t>(i);
      vector[i] = number_from(name, node.children[index], what + entry(node, index));
    }
    return vector;
  }

  const Scenario* scenario_;
  const YamlNode* node_;
  std::string path_;
};

/// Remembers where every key was written and refuses the ones that do not exist.
void survey(const YamlNode& node, const std::string& path, Scenario& scenario) {
  for (std::size_t i = 0; i < node.children.size(); ++i) {
    const YamlNode& child = node.children[i];
    const bool map = node.kind == YamlNode::Kind::map;
    const std::string child_path = map ? (path.empty() ? "" : path + ".") + node.keys[i]
                                       : path + "[" + std::to_string(i) + "]";
    if (child.set_by.empty()) {
      scenario.line[child_path] = child.line;
    } else {
      scenario.set_by[child_path] = child.set_by;
    }
    if (!is_scenario_key(child_path)) {
      throw scenario.complaint(child_path,
                               "unknown; nearest known key is " + nearest_scenario_key(child_path));
    }
    if (has_keys_below(child_path)) survey(child, child_path, scenario);
  }
}

/// The name of the only key of `section` that is among `kinds`; empty when there is none.
std::string only_kind(const Section& section, std::initializer_list<const char*> kinds,
                      const std::string& path, const Scenario& scenario) {
  std::string found;
  std::string all;
  for (const char* kind : kinds) {
    all += (all.empty() ? "" : ", ") + std::string(kind);
    if (section.find(kind) == nullptr) continue;
    if (!found.empty()) {
      throw scenario.complaint(path, "both " + found + " and " + kind + "; allowed: one kind only");
    }
    found = kind;
  }
  if (found.empty()) {
    throw scenario.complaint(path, "no kind is given; allowed: exactly one of " + all);
  }
  return found;
}

void read_robot(const Section& section, Scenario& scenario) {
  RobotSpec& robot = scenario.robot;
  robot.name = section.text("name");
  if (!consists_of(robot.name, "_") || robot.name.size() > 32) {
    throw section.complaint(
        "name", in_quotes(robot.name) + "; allowed: letters, digits and _, at most 32 of them");
  }
  robot.channel_prefix = robot.name;
  std::transform(robot.name.begin(), robot.name.end(), robot.channel_prefix.begin(), [](char c) {
    return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  });
  robot.urdf_path = section.text("urdf");
  robot.gravity_m_per_s2 = section.number("gravity_m_per_s2");
  robot.rigid_rotor_inertia_kgm2 = robot::Vector::Zero(scenario.num_joints);

  const YamlNode joints = section.value("joints");
  if (joints.kind == YamlNode::Kind::scalar && joints.scalar == "rigid") return;
  if (joints.kind != YamlNode::Kind::map) throw section.refusal("joints", emit_line(joints));
  const Section kinds = section.section("joints");
  if (only_kind(kinds, {"rigid", "flexible"}, "robot.joints", scenario) == "rigid") {
    robot.rigid_rotor_inertia_kgm2 = kinds.section("rigid").joints("rotor_inertia_kgm2");
    return;
  }
  const Section flexible = kinds.section("flexible");
  robot.flexible =
      FlexibleJoints{flexible.joints("stiffness_Nm_per_rad"), flexible.joints("rotor_inertia_kgm2"),
                     flexible.joints("motor_damping_Nms_per_rad")};
}

void read_initial(const Section& section, const robot::Model& model, Scenario& scenario) {
  InitialState& initial = scenario.plant.initial;
  initial.position_rad = section.joints("position_rad");
  for (int i = 0; i < scenario.num_joints; ++i) {
    const double position = initial.position_rad[i];
    if (position < model.lower[i] || position > model.upper[i]) {
      throw section.complaint("position_rad",
                              shown(position) + " of joint " +
                                  model.joint_names[static_cast<std::size_t>(i)] +
                                  " is outside its limits in the URDF; allowed: in [" +
                                  shown(model.lower[i]) + ", " + shown(model.upper[i]) + "]");
    }
  }
  initial.velocity_rad_per_s = section.joints("velocity_rad_per_s");
  for (const char* key : {"motor_position_rad", "motor_velocity_rad_per_s"}) {
    if (section.find(key) != nullptr && !scenario.robot.flexible) {
      throw section.complaint(key,
                              "the robot has rigid joints; allowed: only with robot.joints: "
                              "{flexible: …}");
    }
  }
  if (section.find("motor_position_rad") != nullptr) {
    initial.motor_position_rad = section.joints("motor_position_rad");
  }
  if (section.find("motor_velocity_rad_per_s") != nullptr) {
    initial.motor_velocity_rad_per_s = section.joints("motor_velocity_rad_per_s");
  }
}

void read_encoder(const Section& section, Scenario& scenario) {
  EncoderSpec& encoder = scenario.plant.encoder;
  if (section.value("resolution_bits").kind != YamlNode::Kind::null) {
    encoder.resolution_bits = static_cast<int>(section.whole("resolution_bits"));
  }
  encoder.noise_std_rad = section.number("noise_std_rad");
  encoder.velocity_noise_std_rad_per_s = section.number("velocity_noise_std_rad_per_s");
  encoder.seed = static_cast<std::uint64_t>(section.whole("seed"));
  encoder.side = section.choice<EncoderSide>("side");
  if (encoder.side == EncoderSide::motor && !scenario.robot.flexible) {
    throw section.complaint("side",
                            "motor: the robot has rigid joints; allowed: link, both, or "
                            "robot.joints: {flexible: …}");
  }
}

void read_drive(const Section& section, const robot::Model& model, Scenario& scenario) {
  DriveSpec& drive = scenario.plant.drive;
  const YamlNode* limit = section.find("torque_limit_Nm");
  if (limit == nullptr) {
    if (model.effort_limit.array().isFinite().any()) drive.torque_limit_Nm = model.effort_limit;
  } else if (limit->kind != YamlNode::Kind::null) {
    drive.torque_limit_Nm = section.joints("torque_limit_Nm");
  }
  drive.viscous_friction_Nms_per_rad = section.joints("viscous_friction_Nms_per_rad");
}

void read_payload(const Section& section, const robot::Model& model, Scenario& scenario) {
  PayloadSpec& payload = scenario.plant.payload;
  payload.mass_kg = section.number("mass_kg");
  if (section.find("link") != nullptr) {
    payload.link = section.text("link");
    if (model.frames.count(payload.link) == 0) {
      std::string links;
      for (const auto& [link, frame] : model.frames) links += (links.empty() ? "" : ", ") + link;
      throw section.complaint("link",
                              in_quotes(payload.link) + " is not in the URDF; allowed: " + links);
    }
  }
  if (payload.mass_kg == 0) return;
  try {
    robot::with_payload(model, payload.mass_kg, payload.link);
  } catch (const std::invalid_argument& error) {
    throw section.complaint("link", error.what());
  }
}

void read_plant(const Section& section, const robot::Model& model, Scenario& scenario) {
  read_initial(section.section("initial"), model, scenario);
  const Section integrator = section.section("integrator");
  scenario.plant.integrator = {integrator.choice<IntegratorMethod>("method"),
                               integrator.number("accuracy")};
  read_encoder(section.section("encoder"), scenario);
  read_drive(section.section("drive"), model, scenario);
  read_payload(section.section("payload"), model, scenario);
}

Waypoints read_waypoints(const Section& section) {
  Waypoints waypoints{section.numbers("time_s"), section.joints_list("position_rad")};
  if (waypoints.time_s.size() < 2) {
    throw section.complaint(
        "time_s", std::to_string(waypoints.time_s.size()) + " times; allowed: at least 2");
  }
  for (std::size_t i = 1; i < waypoints.time_s.size(); ++i) {
    if (waypoints.time_s[i] <= waypoints.time_s[i - 1]) {
      throw section.complaint("time_s", shown(waypoints.time_s[i]) + " after " +
                                            shown(waypoints.time_s[i - 1]) +
                                            "; allowed: increasing times");
    }
  }
  if (waypoints.position_rad.size() != waypoints.time_s.size()) {
    throw section.complaint(
        "position_rad", std::to_string(waypoints.position_rad.size()) + " positions; allowed: " +
                            std::to_string(waypoints.time_s.size()) + ", one per time");
  }
  return waypoints;
}

ReferenceSpec read_reference(const Section& reference, const Scenario& scenario) {
  const std::string kind =
      only_kind(reference, {"hold", "sinusoid", "multi_sine", "point_to_point", "waypoints"},
                "reference", scenario);
  const Section section = reference.section(kind);
  if (kind == "hold") return Hold{section.joints("position_rad")};
  if (kind == "sinusoid") {
    return Sinusoid{section.joints("amplitude_rad"), section.joints("frequency_hz"),
                    section.joints("phase_rad"), section.joints("offset_rad")};
  }
  if (kind == "multi_sine") {
    MultiSine multi_sine{section.joints("offset_rad"), {}};
    for (const Section& term : section.sections("terms")) {
      multi_sine.terms.push_back({term.joints("amplitude_rad"), term.joints("frequency_hz"),
                                  term.joints("phase_rad"),
                                  robot::Vector::Zero(scenario.num_joints)});
    }
    return multi_sine;
  }
  if (kind == "point_to_point") {
    return PointToPoint{section.joints("from_rad"), section.joints("to_rad"),
                        section.number("start_s"), section.number("duration_s")};
  }
  return read_waypoints(section);
}

void read_controller(const Section& section, Scenario& scenario) {
  ControllerSpec& controller = scenario.controller;
  controller.law = section.text("law");
  if (!consists_of(controller.law, "_", false)) {
    throw section.complaint(
        "law", in_quotes(controller.law) + "; allowed: lower-case letters, digits and _");
  }
  const YamlNode* gains = section.find("gains");
  if (gains == nullptr) {
    throw section.complaint("gains", "missing; allowed: a map of the law's gains");
  }
  const Section by_name = section.section("gains");
  for (const std::string& name : gains->keys) {
    if (!consists_of(name, "_")) {
      throw by_name.complaint(name, "not a gain's name; allowed: letters, digits and _");
    }
    controller.gains[name] = by_name.joints(name);
  }
  controller.filter = section.choice<FilterKind>("filter");
  controller.filter_start = section.choice<FilterStart>("filter_start");
  controller.feedforward_lead = section.choice<FeedforwardLead>("feedforward_lead");
}

void read_loop(const Section& section, Scenario& scenario) {
  LoopSpec& loop = scenario.loop;
  loop.mode = section.choice<Mode>("mode");
  loop.period_s = section.number("period_s");
  loop.duration_s = section.number("duration_s");
  const double ticks = loop.duration_s / loop.period_s;
  if (ticks > max_ticks) {
    throw section.complaint("duration_s", shown(ticks, 6) + " ticks of " + shown(loop.period_s) +
                                              " s; allowed: at most " + shown(max_ticks, 6) +
                                              " ticks");
  }
  const double nearest = std::max(1.0, std::round(ticks));
  const auto off = [&](double duration_s) {
    return std::abs(duration_s / loop.period_s - nearest);
  };
  constexpr double tolerance_ticks = 1e-6;
  if (off(loop.duration_s) > tolerance_ticks) {
    int digits = 6;
    while (digits < 17 &&
           off(std::stod(shown(nearest * loop.period_s, digits))) > tolerance_ticks) {
      ++digits;
    }
    throw section.complaint("duration_s",
                            shown(loop.duration_s) + " is " + shown(ticks, 9) + " periods of " +
                                shown(loop.period_s) +
                                " s; allowed: a whole number of periods, nearest is " +
                                shown(nearest * loop.period_s, digits));
  }
  loop.num_ticks = static_cast<std::int64_t>(nearest);
  loop.command_delay = section.find("command_delay") != nullptr
                           ? static_cast<int>(section.whole("command_delay"))
                       : loop.mode == Mode::realtime ? 1
                                                     : 0;
  loop.max_missed = static_cast<int>(section.whole("max_missed"));
  loop.give_up_s = section.number("give_up_s");
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
  survey(root, "", scenario);
  return root;
}

Scenario read_scenario(const YamlNode& root, std::string_view urdf_text,
                       const std::string& urdf_source, Scenario scenario) {
  scenario.text = emit_yaml(root);
  scenario.robot.urdf_text = urdf_text;
  scenario.digest = digest_of(scenario.text, urdf_text);
  const Section top(scenario, &root, "");
  scenario.name = top.text("name");
  if (!consists_of(scenario.name, "._-") || scenario.name.size() > 100 ||
      scenario.name.front() == '.' || scenario.name.front() == '-') {
    throw top.complaint("name", in_quotes(scenario.name) +
                                    "; allowed: letters, digits, ., _ and -, not . or - first, at "
                                    "most 100 of them");
  }
  if (scenario.text.size() + urdf_text.size() > max_message_bytes) {
    throw top.complaint(
        "robot.urdf",
        "scenario (" + std::to_string(scenario.text.size()) + " bytes) and URDF (" +
            std::to_string(urdf_text.size()) +
            " bytes) must fit one message; allowed: " + std::to_string(max_message_bytes) +
            " bytes in all; leave <visual>, <collision> and comments out of the "
            "URDF");
  }
  const auto refuse_urdf = [&](const std::string& why) {
    return scenario.complaint("robot.urdf", why);
  };
  robot::Model model;
  try {
    model = robot::model_from_urdf(std::string(urdf_text), urdf_source);
  } catch (const std::invalid_argument& error) {
    throw refuse_urdf(error.what());
  }
  if (model.num_joints < 1) throw refuse_urdf(urdf_source + " has no moving joint");
  scenario.num_joints = model.num_joints;

  read_robot(top.section("robot"), scenario);
  read_plant(top.section("plant"), model, scenario);
  scenario.reference = read_reference(top.section("reference"), scenario);
  read_controller(top.section("controller"), scenario);
  read_loop(top.section("loop"), scenario);
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
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot be read; see its permissions");
  std::string text(max_file_bytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (file.bad()) throw std::runtime_error("cannot be read");
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > max_file_bytes) {
    throw std::runtime_error("too large; allowed: at most " + std::to_string(max_file_bytes) +
                             " bytes");
  }
  return text;
}

}  // namespace

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
  const Section robot = Section(scenario, &root, "").section("robot");
  const std::filesystem::path urdf_path = path.parent_path() / robot.text("urdf");
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

}  // namespace tachless::experiment
