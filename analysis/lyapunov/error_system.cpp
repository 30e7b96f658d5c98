#include "lyapunov/error_system.h"

namespace tachless::lyapunov {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd ErrorSystem::inertia(const MatrixXd& link_M) const {
  MatrixXd M = MatrixXd::Zero(num_errors(), num_errors());
  M.topLeftCorner(num_links(), num_links()) = link_M;
  M.diagonal().tail(rotor_inertia.size()) = rotor_inertia;
  return M;
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

MatrixXd stiffness_of(const ErrorSystem& system) {
  const Index N = system.num_errors();
  MatrixXd K = MatrixXd::Zero(2 * N, 2 * N);
  K.topLeftCorner(N, N) = system.kp;
  K.bottomRightCorner(N, N) = system.kd_by_b();
  return K;
}

MatrixXd delta_of(const ErrorSystem& system, const Weights& weights) {
  const auto [eps_1, eps_2] = weights.of(system.num_errors());
  MatrixXd result(eps_1.size(), 2 * eps_1.size());
  result << MatrixXd(eps_1.asDiagonal()), MatrixXd((-eps_2).asDiagonal());
  return result;
}

MatrixXd lyapunov_of_inertia(const Weights& weights, const MatrixXd& M) {
  const Index N = M.rows();
  MatrixXd P = MatrixXd::Zero(3 * N, 3 * N);
  P.block(2 * N, 2 * N, N, N) = M;
  P.block(0, 2 * N, N, N) = weights.eps_1.asDiagonal() * M;
  P.block(2 * N, 0, N, N) = M * weights.eps_1.asDiagonal();
  P.block(N, 2 * N, N, N) = -(weights.eps_2.asDiagonal() * M);
  P.block(2 * N, N, N, N) = -(M * weights.eps_2.asDiagonal());
  return P;
}

MatrixXd lyapunov_matrix(const ErrorSystem& system, const Weights& weights,
                         const MatrixXd& link_M) {
  const Index N = system.num_errors();
  MatrixXd P = lyapunov_of_inertia(weights.of(N), system.inertia(link_M));
  P.topLeftCorner(2 * N, 2 * N) = stiffness_of(system);
  return P;
}

MatrixXd decrease_constant(const ErrorSystem& system, const Weights& weights) {
  const Index N = system.num_errors();
  const auto [eps_1, eps_2] = weights.of(N);
  MatrixXd Mm = MatrixXd::Zero(3 * N, 3 * N);
  Mm.block(0, 0, N, N) = symmetric_part(eps_1.asDiagonal() * system.kp);
  const MatrixXd coupling = 0.5 * (eps_1.asDiagonal() * system.kd - system.kp * eps_2.asDiagonal());
  Mm.block(0, N, N, N) = coupling;
  Mm.block(N, 0, N, N) = coupling.transpose();
  Mm.block(N, N, N, N) =
      system.kd_by_b() * system.a.asDiagonal() - symmetric_part(eps_2.asDiagonal() * system.kd);
  if (system.kp_dot.size() > 0) {
    Mm.block(0, 0, N, N) -= 0.5 * system.kp_dot;
    Mm.block(N, N, N, N) -= 0.5 * system.kd_dot * system.b.cwiseInverse().asDiagonal();
  }
  for (Index i = 0; i < system.damping.size(); ++i) {
    const double D = system.damping[i];
    Mm(2 * N + i, 2 * N + i) = D;
    Mm(i, 2 * N + i) = Mm(2 * N + i, i) = 0.5 * eps_1[i] * D;
    Mm(N + i, 2 * N + i) = Mm(2 * N + i, N + i) = -0.5 * eps_2[i] * D;
  }
  // The rotors' part of what is linear in M.
  for (Index i = system.num_links(); i < N; ++i) {
    const double J = system.rotor_inertia[i - system.num_links()];
    Mm(N + i, 2 * N + i) = Mm(2 * N + i, N + i) = -0.5 * eps_2[i] * system.a[i] * J;
    Mm(2 * N + i, 2 * N + i) = (eps_2[i] * system.b[i] - eps_1[i]) * J;
  }
  return Mm;
}

MatrixXd decrease_of_inertia(const ErrorSystem& system, const Weights& weights, const MatrixXd& M) {
  const Index N = system.num_errors(), n = system.num_links();
  const auto [eps_1, eps_2] = weights.of(N).of(n);
  MatrixXd Mm = MatrixXd::Zero(3 * N, 3 * N);
  const MatrixXd AM = -0.5 * (eps_2.cwiseProduct(system.a.head(n)).asDiagonal() * M);
  Mm.block(N, 2 * N, n, n) = AM;
  Mm.block(2 * N, N, n, n) = AM.transpose();
  Mm.block(2 * N, 2 * N, n, n) =
      symmetric_part((eps_2.cwiseProduct(system.b.head(n)) - eps_1).asDiagonal() * M);
  return Mm;
}

MatrixXd decrease_of_coriolis(const ErrorSystem& system, const Weights& weights,
                              const MatrixXd& Cd) {
  const Index N = system.num_errors(), n = system.num_links();
  const auto [eps_1, eps_2] = weights.of(N).of(n);
  MatrixXd Mm = MatrixXd::Zero(3 * N, 3 * N);
  const MatrixXd W = Cd.transpose() - Cd;
  Mm.block(0, 2 * N, n, n) = -0.5 * eps_1.asDiagonal() * W;
  Mm.block(2 * N, 0, n, n) = 0.5 * W * eps_1.asDiagonal();
  Mm.block(N, 2 * N, n, n) = 0.5 * eps_2.asDiagonal() * W;
  Mm.block(2 * N, N, n, n) = -0.5 * W * eps_2.asDiagonal();
  Mm.block(2 * N, 2 * N, n, n) = symmetric_part(Cd);
  return Mm;
}

}  // namespace tachless::lyapunov
