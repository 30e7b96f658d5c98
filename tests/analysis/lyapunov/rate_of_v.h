#pragma once

#include <Eigen/Core>
#include <cmath>

#include "lyapunov/error_system.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov::testing {

/// Returns the rate of V along the loop of any robot, by the product rule, with the sizes of its
/// terms. The robot's equation of motion and nothing of the certificate enters.
struct RateOfV {
  double sum = 0, size = 0;

  void add(double term) {
    sum += term;
    size += std::abs(term);
  }
  void add_errors(const ErrorSystem& s, const Weights& w, const robot::Model& robot,
                  const Vector& q, const Vector& v, const Eigen::VectorXd& e,
                  const Eigen::VectorXd& edot, const Eigen::VectorXd& eddot,
                  const Eigen::VectorXd& nu) {
    const Eigen::MatrixXd M = robot::mass_matrix(robot, q), C = robot::coriolis_matrix(robot, q, v);
    const Eigen::VectorXd nudot = s.b.cwiseProduct(edot) - s.a.cwiseProduct(nu);
    const Eigen::VectorXd delta = w.eps_1.cwiseProduct(e) - w.eps_2.cwiseProduct(nu);
    const Eigen::VectorXd deltadot = w.eps_1.cwiseProduct(edot) - w.eps_2.cwiseProduct(nudot);
    for (const double term :
         {edot.dot(M * eddot), edot.dot(C * edot), e.dot(s.kp * edot), nu.dot(s.kd_by_b() * nudot),
          deltadot.dot(M * edot), delta.dot((C + C.transpose()) * edot), delta.dot(M * eddot)}) {
      add(term);
    }
  }
};

}  // namespace tachless::lyapunov::testing
