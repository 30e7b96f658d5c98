#include "certificate/error_system.h"

namespace tachless::certificate {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd ErrorSystem::inertia(const MatrixXd& link_M) const {
  MatrixXd M = MatrixXd::Zero(num_errors(), num_errors());
  M.topLeftCorner(num_links(), num_links()) = link_M;
  M.diagonal().tail(rotor_inertia.size()) = rotor_inertia;
  return M;
}

ErrorSystem rigid_error_system(const FilterGains& gains) {
  return {gains.kp.asDiagonal(), gains.kd.asDiagonal(), gains.a, gains.b, {}};
}

ErrorSystem flexible_error_system(const VectorXd& stiffness, const VectorXd& rotor_inertia,
                                  const FilterGains& link, const FilterGains& motor) {
  const Index n = stiffness.size();
  const auto joined = [](const VectorXd& x, const VectorXd& y) {
    VectorXd both(x.size() + y.size());
    both << x, y;
    return both;
  };
  MatrixXd kp = MatrixXd::Zero(2 * n, 2 * n);
  kp.diagonal() = joined(link.kp + stiffness, motor.kp + stiffness);
  kp.topRightCorner(n, n) = (-stiffness).asDiagonal();
  kp.bottomLeftCorner(n, n) = (-stiffness).asDiagonal();
  return {kp, joined(link.kd, motor.kd).asDiagonal(), joined(link.a, motor.a),
          joined(link.b, motor.b), rotor_inertia};
}

MatrixXd lyapunov_matrix(const ErrorSystem& system, const Weights& weights,
                         const MatrixXd& link_M) {
  const Index N = system.num_errors();
  const MatrixXd M = system.inertia(link_M);
  MatrixXd P = MatrixXd::Zero(3 * N, 3 * N);
  P.block(0, 0, N, N) = system.kp;
  P.block(N, N, N, N) = system.kd_by_b();
  P.block(2 * N, 2 * N, N, N) = M;
  P.block(0, 2 * N, N, N) = weights.eps_1 * M;
  P.block(2 * N, 0, N, N) = weights.eps_1 * M;
  P.block(N, 2 * N, N, N) = -weights.eps_2 * M;
  P.block(2 * N, N, N, N) = -weights.eps_2 * M;
  return P;
}

MatrixXd decrease_constant(const ErrorSystem& system, const Weights& weights) {
  const Index N = system.num_errors();
  const auto& [eps_1, eps_2] = weights;
  MatrixXd Mm = MatrixXd::Zero(3 * N, 3 * N);
  Mm.block(0, 0, N, N) = eps_1 * system.kp;
  const MatrixXd coupling = 0.5 * (eps_1 * system.kd - eps_2 * system.kp);
  Mm.block(0, N, N, N) = coupling;
  Mm.block(N, 0, N, N) = coupling.transpose();
  Mm.block(N, N, N, N) = system.kd_by_b() * system.a.asDiagonal() - eps_2 * system.kd;
  if (system.kp_dot.size() > 0) {
    Mm.block(0, 0, N, N) -= 0.5 * system.kp_dot;
    Mm.block(N, N, N, N) -= 0.5 * system.kd_dot * system.b.cwiseInverse().asDiagonal();
  }
  for (Index i = 0; i < system.damping.size(); ++i) {
    const double D = system.damping[i];
    Mm(2 * N + i, 2 * N + i) = D;
    Mm(i, 2 * N + i) = Mm(2 * N + i, i) = 0.5 * eps_1 * D;
    Mm(N + i, 2 * N + i) = Mm(2 * N + i, N + i) = -0.5 * eps_2 * D;
  }
  // The rotors' part of what is linear in M.
  const Index n = system.num_links(), r = system.rotor_inertia.size();
  for (Index i = 0; i < r; ++i) {
    const double J = system.rotor_inertia[i];
    Mm(N + n + i, 2 * N + n + i) = Mm(2 * N + n + i, N + n + i) =
        -0.5 * eps_2 * system.a[n + i] * J;
    Mm(2 * N + n + i, 2 * N + n + i) = (eps_2 * system.b[n + i] - eps_1) * J;
  }
  return Mm;
}

MatrixXd decrease_of_inertia(const ErrorSystem& system, const Weights& weights, const MatrixXd& M) {
  const Index N = system.num_errors(), n = system.num_links();
  MatrixXd Mm = MatrixXd::Zero(3 * N, 3 * N);
  const MatrixXd AM = -0.5 * weights.eps_2 * (system.a.head(n).asDiagonal() * M);
  Mm.block(N, 2 * N, n, n) = AM;
  Mm.block(2 * N, N, n, n) = AM.transpose();
  const MatrixXd BM = system.b.head(n).asDiagonal() * M;
  Mm.block(2 * N, 2 * N, n, n) = 0.5 * weights.eps_2 * (BM + BM.transpose()) - weights.eps_1 * M;
  return Mm;
}

MatrixXd decrease_of_coriolis(const ErrorSystem& system, const Weights& weights,
                              const MatrixXd& Cd) {
  const Index N = system.num_errors(), n = system.num_links();
  MatrixXd Mm = MatrixXd::Zero(3 * N, 3 * N);
  const MatrixXd W = Cd.transpose() - Cd;
  Mm.block(0, 2 * N, n, n) = -0.5 * weights.eps_1 * W;
  Mm.block(2 * N, 0, n, n) = -0.5 * weights.eps_1 * W.transpose();
  Mm.block(N, 2 * N, n, n) = 0.5 * weights.eps_2 * W;
  Mm.block(2 * N, N, n, n) = 0.5 * weights.eps_2 * W.transpose();
  Mm.block(2 * N, 2 * N, n, n) = 0.5 * (Cd + Cd.transpose());
  return Mm;
}

}  // namespace tachless::certificate
