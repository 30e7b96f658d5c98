#include "certify/feedforward_bound.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "base/parallel.h"
#include "controller/registry.h"
#include "lyapunov/law_loop.h"
#include "numerics/postures.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "robot/gravity_bound.h"

namespace tachless::certify {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using messages::ReferencePoint;

/// Returns the friction that is fed forward at the reference.
Vector fed_friction(const scenario::Scenario& scenario, const robot::Model& model,
                    const ReferencePoint& r) {
  const controller::FrictionSpec& friction = scenario.controller.friction;
  return friction.given() ? controller::law::friction_feedforward(friction, model, r, 0)
                          : Vector(Vector::Zero(r.v_ref.size()));
}

FeedforwardBound sampled(const scenario::Scenario& scenario, const robot::Model& model,
                         const reference::Trajectory& trajectory) {
  constexpr int instants = 33, postures = 256;
  FeedforwardBound bound{Vector::Zero(model.num_joints)};
  for (const double t_s : reference::Motion(scenario, trajectory).closely(instants)) {
    const ReferencePoint r = trajectory.at(t_s);
    const Vector added = fed_friction(scenario, model, r);
    for (int k = 0; k <= postures; ++k) {
      const Vector q = k == 0 ? r.q_ref : numerics::spread_posture(model, k);
      const Vector torque = robot::inverse_dynamics(model, q, r.v_ref, r.a_ref) + added;
      bound.torque = bound.torque.cwiseMax(torque.cwiseAbs());
    }
  }
  return bound;
}

/// M and C at one angle of the last joint, and each joint's extreme gravity torques over the other.
struct AtAngle {
  numerics::Inertia inertia;
  Vector least, most;
};

/// The grid of postures, and what the values on it lack of those between.
struct Grid {
  std::vector<AtAngle> at;
  double share = 1;  ///< of the largest value over all postures, that the grid is sure to show
};

Grid grid_of(const robot::Model& model) {
  constexpr int points = 240;  // of a turn
  const Index n = model.num_joints, last = n - 1;
  const VectorXd sigma = 2 * numerics::most_turns(model);  // turns of the energy
  const int denominator = numerics::multiplier_denominator(model);
  const double step = 2 * std::numbers::pi / points;
  Grid grid;
  for (Index j = 0; j < n; ++j) grid.share *= 1 - sigma[j] * sigma[j] * step * step / 8;
  grid.at = base::parallel_map(static_cast<std::size_t>(points * denominator), [&](std::size_t k) {
    Vector q = Vector::Zero(n);
    q[last] = step * static_cast<double>(k);
    AtAngle at{numerics::inertia_at(model, q), robot::gravity_torque(model, q), {}};
    at.most = at.least;
    for (int i = 1; n > 1 && i < points; ++i) {
      q[0] = step * i;
      const Vector gravity = robot::gravity_torque(model, q);
      at.least = at.least.cwiseMin(gravity);
      at.most = at.most.cwiseMax(gravity);
    }
    return at;
  });
  return grid;
}

/// Returns the largest |C(q, x) y| of vectors of these sizes.
VectorXd largest_coriolis(const numerics::Inertia& at, const VectorXd& x, const VectorXd& y) {
  VectorXd sum = VectorXd::Zero(x.size());
  for (Index j = 0; j < x.size(); ++j) {
    sum += x[j] * (at.C[static_cast<std::size_t>(j)].cwiseAbs() * y);
  }
  return sum;
}

/// Returns whether M and C depend on the last of at most two revolute joints alone.
bool has_grid(const robot::Model& model) {
  const bool turns = std::ranges::all_of(model.bodies, [](const robot::Body& body) {
    return body.type == robot::JointType::revolute;
  });
  return turns && model.num_joints <= 2 &&
         numerics::Postures(model, {.circle_points = 1}).kind != numerics::Postures::Kind::sampled;
}

}  // namespace

FeedforwardBound feedforward_bound(const scenario::Scenario& scenario) {
  const robot::Model model = controller::rigid_model(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  if (!has_grid(model)) return sampled(scenario, model, trajectory);
  const lyapunov::MotionBound all = lyapunov::motion_bound(scenario);
  std::vector<ReferencePoint> points;
  double dt = 0;
  const std::vector<double> time_s = reference::Motion(scenario, trajectory).closely(129, 2048);
  for (std::size_t k = 0; k < time_s.size(); ++k) {
    points.push_back(trajectory.at(time_s[k]));
    if (k > 0) dt = std::max(dt, time_s[k] - time_s[k - 1]);
  }
  const Grid grid = grid_of(model);
  const auto most = base::parallel_map(grid.at.size(), [&](std::size_t k) {
    const auto& [inertia, least_gravity, most_gravity] = grid.at[k];
    VectorXd largest = VectorXd::Zero(model.num_joints);
    for (const ReferencePoint& r : points) {
      VectorXd moving = inertia.M * r.a_ref;
      for (Index j = 0; j < r.v_ref.size(); ++j) {
        moving += r.v_ref[j] * (inertia.C[static_cast<std::size_t>(j)] * r.v_ref);
      }
      largest = largest.cwiseMax((moving + least_gravity).cwiseAbs())
                    .cwiseMax((moving + most_gravity).cwiseAbs());
    }
    const VectorXd curvature = inertia.M.cwiseAbs() * all.snap +
                               2 * largest_coriolis(inertia, all.a, all.a) +
                               2 * largest_coriolis(inertia, all.v, all.jerk);
    return VectorXd(largest + dt * dt / 8 * curvature);
  });
  VectorXd largest = VectorXd::Zero(model.num_joints);
  for (const VectorXd& each : most) largest = largest.cwiseMax(each);
  FeedforwardBound bound{largest / grid.share, true};
  if (const controller::FrictionSpec& friction = scenario.controller.friction; friction.given()) {
    bound.torque += friction.viscous.cwiseProduct(Vector(all.v)) +
                    friction.largest_dry(robot::gravity_bound(model));
  }
  return bound;
}

}  // namespace tachless::certify
