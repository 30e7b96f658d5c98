#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <random>

#include "identify/recording.h"
#include "robot/dynamics.h"

/// Tables of arms whose controller is unknown.
namespace tachless::identify {

/// Friction and other errors of a joint's torque [N m], of its velocity and the torque without it.
using JointError = std::function<double(Eigen::Index joint, double v, double load)>;

/// Returns a motion of several sines per joint, which depends on `seed`, and the torques that it
/// takes.
inline Recording table_of_motion(const scenario::Scenario& scenario, const robot::Model& arm,
                                 double seconds, double seed, const JointError& error) {
  constexpr double h = 0.005;
  const auto ticks = static_cast<Eigen::Index>(seconds / h);
  const Eigen::Index n = arm.num_joints;
  Recording run{"a table", scenario, Eigen::MatrixXd(ticks, n), Eigen::MatrixXd(ticks, n), false};
  run.scenario.loop.period_s = h;
  for (Eigen::Index k = 0; k < ticks; ++k) {
    const double t = h * static_cast<double>(k);
    Vector q = Vector::Zero(n), v = q, a = q;
    for (Eigen::Index i = 0; i < n; ++i) {
      for (int term = 1; term <= 4; ++term) {
        const double w = (0.7 + 0.31 * static_cast<double>(i) + seed) * term;
        const double amplitude = 0.5 / term, phase = term * static_cast<double>(i + 1) + seed;
        q[i] += amplitude * std::sin(w * t + phase);
        v[i] += amplitude * w * std::cos(w * t + phase);
        a[i] -= amplitude * w * w * std::sin(w * t + phase);
      }
    }
    Vector tau = robot::inverse_dynamics<double>(arm, q, v, a);
    for (Eigen::Index i = 0; i < n; ++i) tau[i] += error(i, v[i], tau[i]);
    run.q.row(k) = q.transpose();
    run.tau.row(k) = tau.transpose();
  }
  return run;
}

/// Adds white noise of a share of each joint's largest torque.
inline void add_noise(Recording& to, double share) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  const Eigen::RowVectorXd size = share * to.tau.cwiseAbs().colwise().maxCoeff();
  for (Eigen::Index k = 0; k < to.num_ticks(); ++k) {
    for (Eigen::Index j = 0; j < size.size(); ++j) to.tau(k, j) += size[j] * normal(random);
  }
}

}  // namespace tachless::identify
