#include "robot/model.h"

#include <algorithm>
#include <cmath>
#include <locale>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "robot/mass_properties.h"

namespace tachless::robot {
namespace {

/// How far a frame is from the root: moving joints, then metres along the joints' origins.
struct Reach {
  int joints = 0;
  double distance = 0;
};

Reach reach(const Model& model, const Frame& frame) {
  Reach r{0, frame.p_BF.norm()};
  for (int i = frame.body; i >= 0; i = model.bodies[i].parent) {
    ++r.joints;
    r.distance += model.bodies[i].p_PB.norm();
  }
  return r;
}

bool coincide(const Frame& a, const Frame& b, double tolerance_m) {
  return a.body == b.body && (a.p_BF - b.p_BF).norm() <= tolerance_m;
}

}  // namespace

Vector nearest_to_zero(const Model& model) {
  return Vector::Zero(model.num_joints).cwiseMax(model.lower).cwiseMin(model.upper);
}

std::pair<double, double> finite_range(const Model& model, int joint) {
  const double lower = model.lower[joint], upper = model.upper[joint];
  if (std::isfinite(lower) && std::isfinite(upper)) return {lower, upper};
  const bool prismatic = model.joint_types[static_cast<std::size_t>(joint)] == JointType::prismatic;
  const double reach = prismatic ? 1 : std::numbers::pi, middle = std::clamp(0.0, lower, upper);
  return {std::max(lower, middle - reach), std::min(upper, middle + reach)};
}

Vector random_posture(const Model& model, std::mt19937& random) {
  Vector q(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) {
    const auto [low, high] = finite_range(model, j);
    q[j] = low + (high - low) * (random() / 4294967296.0);
  }
  return q;
}

std::vector<std::string> farthest_leaves(const Model& model) {
  std::vector<std::string> leaves;
  Reach far{0, 0};
  for (const auto& [link, frame] : model.frames) {
    if (!frame.leaf || frame.body < 0) continue;
    const Reach r = reach(model, frame);
    const double rounding = 1e-9 * (1 + far.distance);
    const bool same_joints = r.joints == far.joints;
    if (r.joints > far.joints || (same_joints && r.distance > far.distance + rounding)) {
      leaves = {link};
      far = r;
    } else if (same_joints && std::abs(r.distance - far.distance) <= rounding &&
               std::none_of(leaves.begin(), leaves.end(),
                            [&, &leaf = frame](const std::string& other) {
                              return coincide(leaf, model.frames.at(other), rounding);
                            })) {
      leaves.push_back(link);
    }
  }
  return leaves;
}

Model with_payload(Model model, const MassProperties& payload, const std::string& link) {
  if (!std::isfinite(payload.mass) || payload.mass < 0) {
    std::ostringstream out;
    out.imbue(std::locale::classic());
    out << "payload: mass " << payload.mass
        << " kg is not a mass; give a finite value of 0 or more";
    throw std::invalid_argument(out.str());
  }
  const std::vector<std::string> carriers =
      link.empty() ? farthest_leaves(model) : std::vector<std::string>{link};
  if (carriers.size() > 1) {
    throw std::invalid_argument("payload: links '" + carriers.front() + "' and '" +
                                carriers.back() +
                                "' are equally far from the root; name the one that carries it");
  }
  const std::string name = carriers.empty() ? "" : carriers.front();
  const auto found = model.frames.find(name);
  if (found == model.frames.end()) {
    std::string known;
    for (const auto& [other, frame] : model.frames) {
      if (frame.body >= 0) known += (known.empty() ? "" : ", ") + other;
    }
    throw std::invalid_argument("payload: the robot has no link '" + name +
                                "'; its moving links are " + known);
  }
  if (found->second.body < 0) {
    throw std::invalid_argument("payload: link '" + name +
                                "' is fixed to the ground; name a link that moves");
  }
  Body& body = model.bodies[found->second.body];
  const auto& [index, R_BF, p_BF, leaf] = found->second;
  const MassProperties loaded =
      combine({body.mass, body.p_Bcm, body.I_Bcm},
              {payload.mass, p_BF + R_BF * payload.p_cm, rotated(payload.I_cm, R_BF)});
  body.mass = loaded.mass;
  body.p_Bcm = loaded.p_cm;
  body.I_Bcm = loaded.I_cm;
  return model;
}

}  // namespace tachless::robot
