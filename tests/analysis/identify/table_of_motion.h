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

/// Position of a joint over time.
using Path = std::function<double(Eigen::Index joint, double t)>;

/// Returns a motion and the torques that it takes.
inline Recording table_of_path(const scenario::Scenario& scenario, const robot::Model& arm,
                               double seconds, const Path& path, const JointError& error) {
  constexpr double h = 0.005, step = 1e-4;
  const auto ticks = static_cast<Eigen::Index>(seconds / h);
  const Eigen::Index n = arm.num_joints;
  Recording run{"a table", scenario, Eigen::MatrixXd(ticks, n), Eigen::MatrixXd(ticks, n), false};
  run.scenario.loop.period_s = h;
  for (Eigen::Index k = 0; k < ticks; ++k) {
    const double t = h * static_cast<double>(k);
    Vector q(n), v(n), a(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double before = path(i, t - step), after = path(i, t + step);
      q[i] = path(i, t);
      v[i] = (after - before) / (2 * step);
      a[i] = (after - 2 * q[i] + before) / (step * step);
    }
    Vector tau = robot::inverse_dynamics<double>(arm, q, v, a);
    for (Eigen::Index i = 0; i < n; ++i) tau[i] += error(i, v[i], tau[i]);
    run.q.row(k) = q.transpose();
    run.tau.row(k) = tau.transpose();
  }
  return run;
}

/// Returns a motion of several sines per joint, which depends on `seed`, and its torques.
inline Recording table_of_motion(const scenario::Scenario& scenario, const robot::Model& arm,
                                 double seconds, double seed, const JointError& error) {
  const auto path = [seed](Eigen::Index joint, double t) {
    double q = 0;
    for (int term = 1; term <= 4; ++term) {
      const double w = (0.7 + 0.31 * static_cast<double>(joint) + seed) * term;
      q += 0.5 / term * std::sin(w * t + term * static_cast<double>(joint + 1) + seed);
    }
    return q;
  };
  return table_of_path(scenario, arm, seconds, path, error);
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
