#include "cli/mjcf_gains.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "cli/verb.h"
#include "linear/servo_loop.h"
#include "robot/dynamics.h"
#include "robot/mjcf_servos.h"
#include "scenario/description.h"

namespace tachless::cli {
namespace {

using base::ExitCode;
using Json = nlohmann::ordered_json;
using linear::ServoStep;

/// One way to compute a step, and its limits.
struct Row {
  ServoStep kind = ServoStep::euler;
  linear::ServoLimit limit;
  bool stable = false;
  std::optional<double> armature, kv_factor;  ///< that make it stable
};

/// The findings about a MuJoCo model's actuators.
struct Findings {
  robot::Model model;
  robot::MjcfServos servos;
  linear::ServoGains gains;
  double step_s = 0;
  std::vector<Row> rows;
  Vector droop;  ///< [rad; m]
  bool carries_weight = false;
};

std::string_view name_of(ServoStep kind) { return names(kind)[static_cast<std::size_t>(kind)]; }

ServoStep kind_of(const std::string& integrator) {
  if (integrator == "Euler") return ServoStep::euler;
  return integrator == "RK4" ? ServoStep::rk4 : ServoStep::implicit;
}

/// Rounds to three digits, up or down: a remedy as it is typed still works.
double rounded(double value, double (*to)(double)) {
  const double unit = std::pow(10, std::floor(std::log10(value)) - 2);
  return to(value / unit) * unit;
}

std::string text_of_step(double step_s) {
  if (std::isinf(step_s)) {
    return fmt::format("above {:g} ms", 1e3 * linear::longest_servo_step);
  }
  return step_s == 0 ? "none" : fmt::format("{:.4g} ms", 1e3 * step_s);
}

/// Adds the gains of the actuators to the coordinates that they move. Warns of actuators that move
/// none.
linear::ServoGains gains_of(const robot::MjcfServos& servos, const robot::Model& model) {
  const Vector zero = Vector::Zero(model.num_joints);
  linear::ServoGains gains{zero, zero, servos.implicit_joint_damping};
  Vector reference = zero;
  for (const auto& [joint, position] : servos.reference) {
    const auto at = std::ranges::find(model.joint_names, joint);
    if (at != model.joint_names.end()) reference[at - model.joint_names.begin()] = position;
  }
  const Matrix M = robot::mass_matrix<double>(model, reference);
  for (const robot::MjcfServo& servo : servos.servos) {
    const auto body = std::ranges::find(model.bodies, servo.joint, &robot::Body::joint);
    if (body == model.bodies.end()) {
      base::log_warning("actuator '{}': joint '{}' does not move; it is left out", servo.name,
                        servo.joint);
      continue;
    }
    const double square = body->multiplier * body->multiplier;
    const int j = body->coordinate;
    gains.kp[j] += square * servo.kp;
    gains.kv[j] += square * servo.kv;
    if (servo.damping_ratio > 0) {
      gains.kv[j] += 2 * servo.damping_ratio * std::sqrt(square * servo.kp * M(j, j));
    }
  }
  return gains;
}

Findings findings_of(const std::filesystem::path& file, const scenario::RobotFile& given,
                     double step_s) {
  for (const std::string& warning : given.warnings) base::log_warning(warning);
  Findings found;
  try {
    found.model = robot::model_from_urdf(given.urdf, file.string(), given.options);
    found.servos = robot::read_mjcf_servos(given.mjcf, file.string(), scenario::files_beside(file));
  } catch (const std::invalid_argument& problem) {
    throw base::bad_usage(problem.what());
  }
  for (const std::string& warning : found.servos.warnings) base::log_warning(warning);
  if (found.servos.servos.empty()) {
    throw base::bad_usage(
        "{}: it has no position or velocity actuator of a joint; for a law of this library type: "
        "tachless design {} --write scenario.yaml",
        file.string(), file.string());
  }
  found.gains = gains_of(found.servos, found.model);
  found.step_s = step_s > 0 ? step_s : found.servos.step_s;
  found.carries_weight = given.adds_gravity;
  std::vector<Vector> postures = {robot::nearest_to_zero(found.model)};
  const Vector start = scenario::start_posture(given, found.model);
  if (start.size() > 0) postures.push_back(start);
  const linear::ServoLoop loop(found.model, found.gains, postures);
  for (const ServoStep kind : linear::all_servo_steps) {
    Row row{kind, loop.limit(kind), loop.is_stable(kind, found.step_s), {}, {}};
    if (!row.stable) {
      row.armature = loop.least_armature(kind, found.step_s);
      row.kv_factor = loop.largest_kv_factor(kind, found.step_s);
    }
    found.rows.push_back(row);
  }
  found.droop = given.adds_gravity ? Vector::Zero(found.model.num_joints) : loop.droop();
  return found;
}

/// Returns the row of the model's own integrator.
const Row& own_row(const Findings& found) {
  return found.rows[static_cast<std::size_t>(kind_of(found.servos.integrator))];
}

std::string remedies(const Row& row, double step_s) {
  std::vector<std::string> ways;
  if (row.armature) {
    ways.push_back(fmt::format("armature of at least {:.3g} at each joint",
                               rounded(*row.armature, std::ceil)));
  }
  if (row.kv_factor) {
    ways.push_back(
        fmt::format("kv of at most {:.3g} times its value", rounded(*row.kv_factor, std::floor)));
  }
  return fmt::format("  {}, stable at {:g} ms with {}\n", name_of(row.kind), 1e3 * step_s,
                     ways.empty() ? "a shorter step alone" : base::joined(ways, ", or "));
}

std::string steps_text(const Findings& found) {
  const robot::JointLabels labels = robot::joint_labels(found.model);
  std::vector<std::vector<std::string>> table = {{"step by", "largest stable step",
                                                  fmt::format("at {:g} ms", 1e3 * found.step_s),
                                                  "first", "worst posture"}};
  for (const Row& row : found.rows) {
    const bool limited = row.limit.joint >= 0;
    table.push_back({std::string(name_of(row.kind)), text_of_step(row.limit.step_s),
                     row.stable ? "stable" : "UNSTABLE",
                     limited ? labels.name[static_cast<std::size_t>(row.limit.joint)] : "",
                     limited ? fmt::format("[{:.2f}]", fmt::join(row.limit.posture, ", ")) : ""});
  }
  std::string text = base::table(table, "lrlll");
  for (const Row& row : found.rows) {
    if (!row.stable) text += remedies(row, found.step_s);
  }
  return text;
}

std::string joints_text(const Findings& found) {
  const robot::JointLabels labels = robot::joint_labels(found.model);
  std::vector<std::vector<std::string>> table = {
      {"joint", "kp", "kv", "armature", "damping", "droop by gravity"}};
  for (std::size_t i = 0; i < labels.name.size(); ++i) {
    const auto j = static_cast<Eigen::Index>(i);
    const auto entry = [&](const Vector& numbers) {
      return numbers.size() > 0 ? fmt::format("{:.4g}", numbers[j]) : "0";
    };
    constexpr double rounding = 1e-12;
    const std::string droop =
        found.carries_weight        ? "none (gravcomp)"
        : found.droop[j] < rounding ? "none"
        : std::isinf(found.droop[j])
            ? "no kp"
            : fmt::format("up to {:.3g} {}", found.droop[j], labels.length[i]);
    table.push_back({labels.name[i], entry(found.gains.kp), entry(found.gains.kv),
                     entry(found.model.rotor_inertia), entry(found.model.damping), droop});
  }
  return base::table(table, "lrrrrl");
}

std::string text_of(const Findings& found, const std::string& file) {
  const Row& own = own_row(found);
  const std::string where =
      own.limit.joint < 0
          ? ""
          : fmt::format(
                ", first {}",
                robot::joint_labels(found.model).name[static_cast<std::size_t>(own.limit.joint)]);
  const std::size_t count = found.servos.servos.size();
  return fmt::format("{}: {} position actuator{}, {} with a step of {:g} ms: {} (limit {}{})\n",
                     file, count, count == 1 ? "" : "s", found.servos.integrator,
                     1e3 * found.step_s, own.stable ? "stable" : "UNSTABLE",
                     text_of_step(own.limit.step_s), where) +
         steps_text(found) + joints_text(found);
}

Json json_of(const Findings& found, const std::string& file) {
  Json json = {{"model", file},
               {"integrator", found.servos.integrator},
               {"step_s", found.step_s},
               {"stable", own_row(found).stable},
               {"joints", found.model.joint_names},
               {"kp", base::json_list(found.gains.kp)},
               {"kv", base::json_list(found.gains.kv)},
               {"droop", base::json_list(found.droop)}};
  for (const Row& row : found.rows) {
    Json each = {{"by", name_of(row.kind)},
                 {"largest_stable_step_s", nullptr},
                 {"stable", row.stable},
                 {"first_joint", nullptr},
                 {"worst_posture", base::json_list(row.limit.posture)},
                 {"least_armature", nullptr},
                 {"largest_kv_factor", nullptr}};
    if (std::isfinite(row.limit.step_s)) each["largest_stable_step_s"] = row.limit.step_s;
    if (row.limit.joint >= 0) {
      each["first_joint"] = found.model.joint_names[static_cast<std::size_t>(row.limit.joint)];
    }
    if (row.armature) each["least_armature"] = *row.armature;
    if (row.kv_factor) each["largest_kv_factor"] = *row.kv_factor;
    json["steps"].push_back(std::move(each));
  }
  return json;
}

}  // namespace

std::optional<scenario::RobotFile> mjcf_file(const std::filesystem::path& file,
                                             const std::vector<std::string>& overrides) {
  const bool other = is_yaml(file) || file.extension() == ".xacro";
  if (other || !std::filesystem::is_regular_file(file)) return {};
  scenario::RobotFile read = scenario::robot_file(file, overrides);
  if (read.mjcf.empty()) return {};
  return read;
}

ExitCode check_mjcf_gains(const std::filesystem::path& file, const scenario::RobotFile& model,
                          double step_s, bool json) {
  const Findings found = findings_of(file, model, step_s);
  print(json, json_of(found, file.string()), text_of(found, file.string()));
  return own_row(found).stable ? ExitCode::done : ExitCode::check_said_no;
}

}  // namespace tachless::cli
