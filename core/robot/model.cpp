#include "robot/model.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>

#include "robot/cholesky.h"
#include "robot/dynamics.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

/// Distance of a frame from the root, in moving joints and in metres along the joints' origins.
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

/// Returns the joints at which a factorisation of inertia matrix M has no positive pivot. Each
/// joint found is removed from M before the next factorisation.
std::vector<std::string> joints_without_inertia(const Model& model, Matrix M) {
  constexpr double rounding = 1e-12;
  std::vector<std::string> joints;
  while (std::ssize(joints) <= M.rows()) {  // no joint fails twice
    Matrix factor = M;
    const int failed = factorise(factor, rounding);
    if (failed < 0) break;
    joints.push_back(model.joint_names[static_cast<std::size_t>(failed)]);
    M.row(failed).setZero();
    M.col(failed).setZero();
    M(failed, failed) = 1;
  }
  return joints;
}

}  // namespace

MassProperties combine(const MassProperties& a, const MassProperties& b) {
  // A sum with nothing must not round.
  if (a.mass == 0 && a.I_Bcm.isZero(0)) return b;
  if (b.mass == 0 && b.I_Bcm.isZero(0)) return a;
  MassProperties both;
  both.mass = a.mass + b.mass;
  if (both.mass == 0) return {0, a.p_Bcm, a.I_Bcm + b.I_Bcm};
  both.p_Bcm = (a.mass * a.p_Bcm + b.mass * b.p_Bcm) / both.mass;
  const Eigen::Vector3d d = b.p_Bcm - a.p_Bcm;
  const double reduced = a.mass * b.mass / both.mass;
  both.I_Bcm = a.I_Bcm + b.I_Bcm +
               reduced * (d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose());
  return both;
}

Eigen::Matrix3d rotated(const Eigen::Matrix3d& I, const Eigen::Matrix3d& R) {
  if (R.isIdentity(0)) return I;
  const Eigen::Matrix3d product = R * I * R.transpose();
  return 0.5 * (product + product.transpose());
}

std::string why_not_physical(const MassProperties& body) {
  if (!std::isfinite(body.mass) || body.mass < 0) {
    return fmt::format("mass {:g} kg is not a mass; give a finite value of 0 or more", body.mass);
  }
  if (!body.p_Bcm.allFinite() || !body.I_Bcm.allFinite()) {
    return "inertial origin or inertia is not finite; give finite numbers";
  }
  if (body.mass == 0 && !body.I_Bcm.isZero(0)) {
    return "inertia without mass; give it a mass, or inertia 0 as well";
  }
  const Eigen::Vector3d I =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(body.I_Bcm, Eigen::EigenvaluesOnly)
          .eigenvalues();
  constexpr double gyration_m = 1e-6;
  const double rounding = 1e-6 * I.cwiseAbs().maxCoeff() + body.mass * gyration_m * gyration_m;
  if (I[0] < -rounding) {
    return fmt::format(
        "inertia has principal moment {:g} kg m2; a body's are 0 or more: correct ixx ... izz",
        I[0]);
  }
  if (I[0] + I[1] < I[2] - rounding) {
    return fmt::format(
        "principal moments of inertia {0:g}, {1:g}, {2:g} kg m2 violate the triangle inequality "
        "({2:g} > {0:g} + {1:g}): no body has them; correct ixx ... izz",
        I[0], I[1], I[2]);
  }
  return "";
}

std::string JointLabels::joint(std::size_t i) const {
  return fmt::format("joint {} ({})", i + 1, name[i]);
}

JointLabels joint_labels(const Model& model) {
  JointLabels labels{model.joint_names, {}, {}};
  for (const JointType type : model.joint_types) {
    const bool revolute = type == JointType::revolute;
    labels.length.emplace_back(revolute ? "rad" : "m");
    labels.effort.emplace_back(revolute ? "N m" : "N");
  }
  return labels;
}

double speed_limit(const Model& model, Eigen::Index joint, double q, double v) {
  const double most = model.velocity_limit[joint];
  if (model.deceleration_limit.size() == 0 || v == 0) return most;
  const double deceleration = model.deceleration_limit[joint];
  if (!std::isfinite(deceleration)) return most;
  const double left = v > 0 ? model.upper[joint] - q : q - model.lower[joint];
  const double braked = std::sqrt(2 * deceleration * std::max(0.0, left));
  return std::min(most, std::max(0.0, braked - model.velocity_offset[joint]));
}

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
  const auto refused = [](const std::string& why) {
    return std::invalid_argument("payload: " + why);
  };
  if (!std::isfinite(payload.mass) || payload.mass < 0) throw refused(why_not_physical(payload));
  const std::vector<std::string> carriers =
      link.empty() ? farthest_leaves(model) : std::vector<std::string>{link};
  if (carriers.size() > 1) {
    throw refused(fmt::format(
        "links '{}' and '{}' are equally far from the root; name the one that carries it",
        carriers.front(), carriers.back()));
  }
  const std::string name = carriers.empty() ? "" : carriers.front();
  const auto found = model.frames.find(name);
  if (found == model.frames.end()) {
    std::vector<std::string> known;
    for (const auto& [other, frame] : model.frames) {
      if (frame.body >= 0) known.push_back(other);
    }
    throw refused(fmt::format("the robot has no link '{}'; its moving links are {}", name,
                              fmt::join(known, ", ")));
  }
  const auto& [index, R_BF, p_BF, leaf] = found->second;
  if (index < 0) {
    throw refused(fmt::format("link '{}' is fixed to the ground; name a link that moves", name));
  }
  MassProperties& body = model.bodies[static_cast<std::size_t>(index)];
  body = combine(body, {payload.mass, p_BF + R_BF * payload.p_Bcm, rotated(payload.I_Bcm, R_BF)});
  return model;
}

bool is_possible(const Model& model) {
  return std::all_of(model.bodies.begin(), model.bodies.end(),
                     [](const Body& body) { return why_not_physical(body).empty(); });
}

std::vector<std::string> joints_without_inertia(const Model& model) {
  // A joint without mass makes M singular at nearly every posture, an impossible inertia at some.
  const int postures = is_possible(model) ? 8 : 1000;
  std::mt19937 random(1);
  Vector q = nearest_to_zero(model);
  for (int k = 0; k < postures; ++k) {
    std::vector<std::string> joints = joints_without_inertia(model, mass_matrix<double>(model, q));
    if (!joints.empty()) return joints;
    for (int j = 0; j < model.num_joints; ++j) {
      const auto [low, high] = finite_range(model, j);
      q[j] = low + (high - low) * (random() / 4294967296.0);
    }
  }
  return {};
}

void require_positive_inertia(const Model& model, const std::string& source) {
  const std::vector<std::string> joints = joints_without_inertia(model);
  if (joints.empty()) return;
  constexpr const char* rotor = "rotor: robot.joints: {rigid: {rotor_inertia_kgm2: ...}}";
  const bool shapes_only = std::all_of(model.bodies.begin(), model.bodies.end(), [](const Body& b) {
    return b.mass == 0 && b.I_Bcm.isZero(0);
  });
  refuse_urdf(
      source,
      shapes_only
          ? fmt::format("no link that moves has an <inertial>: it describes shapes, not masses; "
                        "give the links one, or every joint a {}",
                        rotor)
          : fmt::format("joint '{}' moves no inertia of its own (the inertia matrix is not "
                        "positive definite); give the links it moves a mass and an inertia, or the "
                        "joint a {}, or fix the joint: robot.locked: {{{}: ...}}",
                        fmt::join(joints, "', '"), rotor, fmt::join(joints, ": ..., ")));
}

}  // namespace tachless::robot
