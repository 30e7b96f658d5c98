#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "robot/kinematics.h"
#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"

namespace tachless::scenario {
namespace {

bool bounded(const robot::Model& model, int joint) {
  return std::isfinite(model.lower[joint]) && std::isfinite(model.upper[joint]);
}

/// Returns the middle of each joint's range, and 0 for a joint without one.
Vector middle_of(const robot::Model& model) {
  Vector middle = Vector::Zero(model.num_joints);
  for (int i = 0; i < model.num_joints; ++i) {
    if (bounded(model, i)) middle[i] = 0.5 * (model.lower[i] + model.upper[i]);
  }
  return middle;
}

/// Returns the end of a motion from `from`. The motion covers 0.3 rad (0.1 m), at most a quarter of
/// the range, away from the nearer limit.
Vector end_of(const robot::Model& model, const Vector& from) {
  const Vector middle = middle_of(model);
  Vector to = from;
  for (int i = 0; i < model.num_joints; ++i) {
    const bool slides =
        model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::prismatic;
    double step = slides ? 0.1 : 0.3;
    if (bounded(model, i)) step = std::min(step, 0.25 * (model.upper[i] - model.lower[i]));
    to[i] += bounded(model, i) && from[i] > middle[i] ? -step : step;
  }
  return to;
}

/// Returns true if a link's origin is below the robot's base plane during the motion.
bool meets_the_floor(const robot::Model& model, const Vector& from, const Vector& to) {
  for (int k = 0; k <= 4; ++k) {
    const Vector q = from + 0.25 * k * (to - from);
    for (const auto& [name, frame] : model.frames) {
      if (robot::frame_pose(model, frame, q).p.z() < -1e-3) return true;
    }
  }
  return false;
}

/// Returns the middle of the range, or a posture near it from which a motion does not meet the
/// floor.
Vector start_of(const robot::Model& model) {
  const Vector middle = middle_of(model);
  constexpr int tries = 500;
  for (int k = 0; k < tries; ++k) {
    Vector q = middle;
    for (int i = 0; i < model.num_joints; ++i) {
      const double range = bounded(model, i) ? model.upper[i] - model.lower[i] : 2 * M_PI;
      // The tries fill a box that grows up to half of the range.
      const double place = std::fmod(k * std::sqrt(2.0 + i), 1.0) - 0.5;
      q[i] += 0.5 * std::min(range, 2 * M_PI) * place * k / tries;
    }
    if (!meets_the_floor(model, q, end_of(model, q))) return q;
  }
  return middle;  // the robot is on a wall, or hangs
}

std::string list(const Vector& values) {
  return fmt::format("[{:.6g}]", fmt::join(values.begin(), values.end(), ", "));
}

}  // namespace

Vector start_posture(const robot::Description& description, const robot::Model& model) {
  Vector posture = Vector::Zero(model.num_joints);
  for (int i = 0; i < model.num_joints; ++i) {
    const auto at = description.start.find(model.joint_names[static_cast<std::size_t>(i)]);
    if (at == description.start.end()) return {};
    posture[i] = at->second;
    if (posture[i] < model.lower[i] || posture[i] > model.upper[i]) return {};
  }
  return posture;
}

std::string urdf_scenario(const robot::Model& model, const UrdfScenario& options) {
  const Vector from = options.from.size() > 0 ? options.from : start_of(model);
  const Vector to = end_of(model, from);
  // The polynomial of degree 9 peaks at 2.46 times its mean speed.
  const double fastest = ((to - from).cwiseAbs().cwiseQuotient(model.velocity_limit)).maxCoeff();
  const double duration = std::ceil(10 * std::clamp(3 * fastest, 2.0, 50.0)) / 10;
  const auto ticks = static_cast<long long>(std::ceil((duration + 3) / options.period_s));
  const std::string start =  // a given start stays as it is, since it may be at a limit
      options.from.size() > 0 ? fmt::format("[{}]", fmt::join(from, ", ")) : list(from);
  const char* bits = "20";  // null: a prismatic joint has no range for its counts
  for (int i = 0; i < model.num_joints; ++i) {
    const robot::JointType type = model.joint_types[static_cast<std::size_t>(i)];
    if (type == robot::JointType::prismatic && !bounded(model, i)) bits = "null";
  }
  std::string friction;
  if (model.damping.any() || model.friction.any()) {
    friction = fmt::format("  friction: {{viscous: {}, coulomb: {}}}\n", list(model.damping),
                           list(model.friction));
  }
  return fmt::format(
      "name: {}\n"
      "robot:\n  name: arm\n  urdf: {}  joints: rigid\n{}"
      "plant:\n  initial: {{position_rad: {}, torque: hold}}\n  encoder: {{resolution_bits: {}}}\n"
      "reference:\n  point_to_point:\n    from_rad: {}\n    to_rad: {}\n"
      "    start_s: 0.2\n    duration_s: {:g}\n"
      "controller:\n  law: loria_ortega_rigid\n  gains: {{kp: 1, kd: 1, a: 1, b: 1}}\n"
      "  filter: tustin\n  feedforward_lead: half_tick_plus_delay\n{}"
      "loop: {{mode: lockstep, period_s: {:g}, duration_s: {:.12g}, command_delay: 1}}\n",
      options.name, emit_yaml({YamlNode::Kind::scalar, options.urdf}),
      options.adds_gravity ? "  compensates: {gravity: true}\n" : "", start, bits, start, list(to),
      duration, friction, options.period_s, static_cast<double>(ticks) * options.period_s);
}

}  // namespace tachless::scenario
