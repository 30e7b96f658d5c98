#pragma once

#include <Eigen/Core>
#include <utility>

#include "controller/law/filter.h"
#include "linear/linear_loop.h"
#include "lyapunov/error_system.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

/// The paper's laws linearised on paper: what `linearised` has to find by differences.
namespace tachless::linear::testing {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// How a sampled filter is made.
struct Sampling {
  controller::law::Discretisation filter = controller::law::Discretisation::first_order_hold;
  double period_s = 1e-3;
};

/// phi and beta of every joint's filter.
struct Filters {
  VectorXd phi, beta;

  Filters(const controller::law::FilterGains& gains, const Sampling& sampling)
      : phi(gains.a.size()), beta(gains.a.size()) {
    for (Index i = 0; i < phi.size(); ++i) {
      const auto joint = controller::law::filter_coefficients(sampling.filter, gains.a[i],
                                                              gains.b[i], sampling.period_s);
      phi[i] = joint.phi;
      beta[i] = joint.beta;
    }
  }
  // One state per joint: s_k = phi nu_{k-1} - beta e_{k-1}, so that nu_k = s_k + beta e_k and
  // s_{k+1} = phi s_k + (phi - 1) beta e_k.
  [[nodiscard]] VectorXd input() const { return (phi.array() - 1) * beta.array(); }
};

/// tau = ID(q, v_ref, vdot_ref) - Kp e - Kd nu (law 1), about any motion: `feedforward_gradient` is
/// the gradient of ID with respect to q there.
inline LinearLaw linear_rigid_law(const controller::law::FilterGains& gains,
                                  const MatrixXd& feedforward_gradient, const Sampling& sampling) {
  const Filters filter(gains, sampling);
  MatrixXd D = feedforward_gradient;
  D.diagonal() -= gains.kp + gains.kd.cwiseProduct(filter.beta);
  return {
      filter.phi.asDiagonal(), filter.input().asDiagonal(), (-gains.kd).asDiagonal(), D, {Part::q},
      feedforward_gradient};
}

/// The flexible law (law 2) about rest at q.
inline LinearLaw linear_flexible_law(const robot::Model& links, const Vector& q,
                                     const VectorXd& stiffness, const VectorXd& rotor_inertia,
                                     const controller::law::FilterGains& link,
                                     const controller::law::FilterGains& motor,
                                     const Sampling& sampling) {
  const Index n = links.num_joints;
  const Filters filter_1(link, sampling), filter_2(motor, sampling);
  const MatrixXd of_q = gradient_by_q(links, constant_reference(q));
  const MatrixXd M = robot::mass_matrix(links, q);
  const MatrixXd inverse_M = numerics::inverse(M);
  // Every quantity is a row of blocks over (s_1, s_2, q, v, theta).
  const auto unit = [&](Index block) {
    MatrixXd row = MatrixXd::Zero(n, 5 * n);
    row.middleCols(block * n, n).setIdentity();
    return row;
  };
  const auto scaled = [](const VectorXd& d, const MatrixXd& row) {
    return MatrixXd(d.asDiagonal() * row);
  };
  const MatrixXd s_1 = unit(0), s_2 = unit(1), e_1 = unit(2), v = unit(3), theta = unit(4);
  const MatrixXd vdot = inverse_M * (scaled(stiffness, theta - e_1) - of_q * e_1);
  const MatrixXd nu_1 = s_1 + scaled(filter_1.beta, e_1);
  const MatrixXd nu_1dot = scaled(link.b, v) - scaled(link.a, nu_1);
  const MatrixXd nu_1ddot = scaled(link.b, vdot) - scaled(link.a, nu_1dot);
  // K (theta_ref - q_ref), of the motors' reference, and its second derivative.
  const MatrixXd torque = of_q * e_1 - scaled(link.kp, e_1) - scaled(link.kd, nu_1);
  const MatrixXd torque_ddot = of_q * vdot - scaled(link.kp, vdot) - scaled(link.kd, nu_1ddot);
  const MatrixXd e_2 = theta - scaled(stiffness.cwiseInverse(), torque);
  const MatrixXd nu_2 = s_2 + scaled(filter_2.beta, e_2);
  const MatrixXd tau = scaled(rotor_inertia.cwiseQuotient(stiffness), torque_ddot) + torque -
                       scaled(motor.kp, e_2) - scaled(motor.kd, nu_2);
  MatrixXd next(2 * n, 5 * n);
  next << scaled(filter_1.phi, s_1) + scaled(filter_1.input(), e_1),
      scaled(filter_2.phi, s_2) + scaled(filter_2.input(), e_2);
  LinearLaw law{next.leftCols(2 * n),
                next.rightCols(3 * n),
                tau.leftCols(2 * n),
                tau.rightCols(3 * n),
                {Part::q, Part::v, Part::theta}};
  if (links.gravity.isZero(0)) return law;
  robot::Model weightless = links;
  weightless.gravity.setZero();
  law.compensation =
      law.D - linear_flexible_law(weightless, q, stiffness, rotor_inertia, link, motor, sampling).D;
  return law;
}

}  // namespace tachless::linear::testing
