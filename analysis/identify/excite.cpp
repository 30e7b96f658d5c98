#include "identify/excite.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "base/failure.h"
#include "identify/least_squares.h"
#include "numerics/decompositions.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int candidates = 60;
constexpr int harmonics = 6;
constexpr double base_hz = 0.1, highest_hz = 1;
constexpr double row_s = 0.2;      ///< between waypoints, a fifth of the fastest period
constexpr double ramp_s = 2;       ///< of the envelope at each end
constexpr double sample_s = 0.01;  ///< step at which regression and limits are evaluated
constexpr double of_range = 0.9, of_limit = 0.8, usual_speed = 1;

/// Returns the largest deflection from the start that each joint has on both sides.
VectorXd room(const scenario::Scenario& scenario, double reach) {
  const Vector& start = scenario.plant.initial.position_rad;
  const robot::Model& model = *scenario.model;
  VectorXd result = VectorXd::Constant(scenario.num_joints, reach);
  for (int i = 0; i < scenario.num_joints; ++i) {
    if (!std::isfinite(model.lower[i]) && !std::isfinite(model.upper[i])) continue;
    const auto [lower, upper] = robot::finite_range(model, i);
    const double middle = (lower + upper) / 2, half = of_range * (upper - lower) / 2;
    const double side = half - std::abs(start[i] - middle);
    if (side < std::min(0.02, half / 2)) {  // a gripper finger's whole range is shorter
      throw scenario.complaint(
          "plant.initial.position_rad",
          "joint {} begins {:.2g} from the end of its range; begin further inside",
          model.joint_names[static_cast<std::size_t>(i)], side);
    }
    result[i] = std::min(reach, side);
  }
  return result;
}

/// Draws offsets from the start, one row per waypoint. Each row begins and ends with zero.
MatrixXd draw(std::mt19937& random, const VectorXd& start, const VectorXd& most,
              Eigen::Index rows) {
  std::uniform_real_distribution<double> part(0, 1);
  MatrixXd result = MatrixXd::Zero(rows, start.size());
  const double end = static_cast<double>(rows - 1) * row_s;
  for (Eigen::Index j = 0; j < start.size(); ++j) {
    for (int h = 0; h < harmonics; ++h) {
      // Low frequencies excite gravity and friction, high frequencies inertia.
      const double hz = base_hz * std::round(std::pow(highest_hz / base_hz, part(random)));
      const double phase = 2 * std::numbers::pi * part(random), amplitude = part(random) / hz;
      for (Eigen::Index k = 0; k < rows; ++k) {
        const double t = static_cast<double>(k) * row_s;
        result(k, j) += amplitude * std::sin(2 * std::numbers::pi * hz * t + phase);
      }
    }
    for (Eigen::Index k = 0; k < rows; ++k) {
      const double t = static_cast<double>(k) * row_s;
      const double x = std::clamp(std::min(t, end - t) / ramp_s, 0.0, 1.0);
      result(k, j) *= x * x * (3 - 2 * x);
    }
    result.col(j) *= most[j] / std::max(1e-12, result.col(j).cwiseAbs().maxCoeff());
  }
  return result;
}

/// Returns the waypoints as overrides of the scenario.
std::vector<std::string> overrides_of(const MatrixXd& offset, const VectorXd& start,
                                      double period_s) {
  std::string times, rows;
  for (Eigen::Index k = 0; k < offset.rows(); ++k) {
    const VectorXd q = start + offset.row(k).transpose();
    times += fmt::format("{}{:.6g}", k > 0 ? ", " : "", static_cast<double>(k) * row_s);
    rows += fmt::format("{}[{:.5g}]", k > 0 ? ", " : "", fmt::join(q, ", "));
  }
  const double end = static_cast<double>(offset.rows() - 1) * row_s;
  return {fmt::format("reference={{waypoints: {{time_s: [{}], position_rad: [{}]}}}}", times, rows),
          fmt::format("loop.duration_s={:.12g}", std::ceil((end + 0.5) / period_s) * period_s)};
}

struct Motion {
  Recording recording;     ///< torques of the arm without unknowns
  VectorXd speed, torque;  ///< largest of each joint
  VectorXd holding;        ///< torque at rest at the start
};

Motion motion_of(const scenario::Scenario& scenario) {
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const auto rows = static_cast<Eigen::Index>(scenario.loop.duration_s / sample_s);
  const Eigen::Index n = scenario.num_joints;
  Motion motion{{"the motion", scenario, MatrixXd(rows, n), MatrixXd::Zero(rows, n)},
                VectorXd::Zero(n),
                VectorXd::Zero(n),
                {}};
  motion.recording.scenario.loop.period_s = sample_s;
  robot::Model model = scenario::with_payload(scenario, *scenario.model);
  model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  const plant::DriveSpec& drive = scenario.plant.drive;
  for (Eigen::Index k = 0; k < rows; ++k) {
    const messages::ReferencePoint at = trajectory.at(static_cast<double>(k) * sample_s);
    motion.recording.q.row(k) = at.q_ref.transpose();
    motion.speed = motion.speed.cwiseMax(at.v_ref.cwiseAbs());
    const Vector tau =
        robot::inverse_dynamics<double>(model, at.q_ref, at.v_ref, at.a_ref).cwiseAbs() +
        drive.viscous_friction_Nms_per_rad.cwiseProduct(at.v_ref.cwiseAbs()) +
        drive.coulomb_friction_Nm;
    if (k == 0) motion.holding = tau;
    motion.torque = motion.torque.cwiseMax(tau);
  }
  return motion;
}

/// Returns the factors by which the joints' motions have to shrink to keep speeds and torques; 1:
/// none.
VectorXd shrink(const scenario::Scenario& scenario, const Motion& motion) {
  VectorXd factor = VectorXd::Ones(motion.speed.size());
  const Vector& rated = scenario.model->velocity_limit;
  for (Eigen::Index i = 0; i < factor.size(); ++i) {
    const double speed = std::isfinite(rated[i]) ? of_limit * rated[i] : usual_speed;
    factor[i] = std::min(1.0, speed / std::max(1e-12, motion.speed[i]));
  }
  if (!scenario.plant.drive.torque_limit_Nm) return factor;
  const VectorXd left = of_limit * *scenario.plant.drive.torque_limit_Nm - motion.holding;
  // A joint's torque depends on the motions of all joints, so one factor serves all.
  const VectorXd moving = (motion.torque - motion.holding).cwiseMax(1e-12);
  return factor * std::clamp(left.cwiseQuotient(moving).minCoeff(), 0.0, 1.0);
}

double condition_of(const Regression& regression) {
  MatrixXd columns = regression.columns;
  for (Eigen::Index row = 0; row < columns.rows(); ++row) {
    columns.row(row) /= std::max(1e-9, regression.peak[regression.joint[row]]);
  }
  columns.array().rowwise() /= columns.colwise().norm().cwiseMax(1e-12).array();
  const VectorXd singular = numerics::singular_values(columns);
  return singular.maxCoeff() / std::max(1e-12, singular.minCoeff());
}

}  // namespace

Excitation excite(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                  const ExcitationGoal& goal, const Report& report) {
  if (scenario.robot.flexible) throw scenario.complaint("robot.joints", "flexible; needed: rigid");
  const Parameters parameters(scenario, unknown);
  const VectorXd start = scenario.plant.initial.position_rad, most = room(scenario, goal.reach);
  const auto rows = static_cast<Eigen::Index>(std::round(goal.duration_s / row_s)) + 1;
  std::mt19937 random(1);
  Excitation best;
  best.condition = std::numeric_limits<double>::infinity();
  const auto with = [&](const std::vector<std::string>& overrides) {
    return scenario::parse_scenario(scenario.text, scenario.robot.urdf_text, scenario.source,
                                    overrides);
  };
  for (int i = 0; i < candidates; ++i) {
    if (i % 10 == 0) report(fmt::format("motion {} of {}", i + 1, candidates));
    MatrixXd offset = draw(random, start, most, rows);
    std::vector<std::string> overrides = overrides_of(offset, start, scenario.loop.period_s);
    Motion motion = motion_of(with(overrides));
    for (int pass = 0; pass < 8; ++pass) {
      const VectorXd factor = shrink(scenario, motion);
      if (factor.minCoeff() >= 1) break;
      offset = offset * (0.99 * factor).cwiseMin(1).asDiagonal();
      overrides = overrides_of(offset, start, scenario.loop.period_s);
      motion = motion_of(with(overrides));
    }
    if ((shrink(scenario, motion).array() < 1).any()) continue;
    motion.recording.tau.rowwise() = motion.torque.transpose();  // scale of each joint's rows
    const double condition = condition_of(regression(motion.recording, parameters));
    if (condition >= best.condition) continue;
    best = {overrides, condition, offset.cwiseAbs().colwise().maxCoeff().transpose(), motion.speed,
            motion.torque};
  }
  if (best.overrides.empty()) {
    throw scenario.complaint(
        "plant.drive.torque_limit_Nm",
        "holding the arm at its start takes four fifths of it or more; begin nearer to upright or "
        "hanging");
  }
  return best;
}

}  // namespace tachless::identify
