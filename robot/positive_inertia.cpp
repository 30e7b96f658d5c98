#include "robot/positive_inertia.h"

#include <fmt/format.h>

#include <algorithm>
#include <random>

#include "robot/cholesky.h"
#include "robot/mass_matrix.h"
#include "robot/mass_properties.h"
#include "robot/urdf_tree.h"

namespace tachless::robot {
namespace {

/// Of inertia matrix M: the joint of the first pivot that is not positive, then without that joint.
std::vector<std::string> joints_without_inertia(const Model& model, Matrix M) {
  constexpr double rounding = 1e-12;
  std::vector<std::string> joints;
  while (true) {
    Matrix factor = M;
    const int failed = factorise(factor, rounding);
    if (failed < 0) return joints;
    joints.push_back(model.joint_names[static_cast<std::size_t>(failed)]);
    M.row(failed).setZero();
    M.col(failed).setZero();
    M(failed, failed) = 1;
  }
}

}  // namespace

bool is_possible(const Model& model) {
  return std::all_of(model.bodies.begin(), model.bodies.end(), [](const Body& body) {
    return why_not_physical({body.mass, body.p_Bcm, body.I_Bcm}).empty();
  });
}

std::vector<std::string> joints_without_inertia(const Model& model) {
  // Without mass, M is singular at nearly every posture; with impossible inertias at some.
  const int postures = is_possible(model) ? 8 : 1000;
  std::mt19937 random(1);
  Vector q = nearest_to_zero(model);
  for (int k = 0; k < postures; ++k) {
    std::vector<std::string> joints = joints_without_inertia(model, mass_matrix<double>(model, q));
    if (!joints.empty()) return joints;
    q = random_posture(model, random);
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
