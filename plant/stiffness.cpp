#include "plant/stiffness.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tachless::plant {

double fastest_rate(const robot::Matrix& M, const FlexibleDrive* flexible,
                    const robot::Vector& viscous_friction) {
  const Eigen::Index n = M.rows();
  const Eigen::Index coordinates = flexible != nullptr ? 2 * n : n;
  Eigen::MatrixXd inertia = Eigen::MatrixXd::Zero(coordinates, coordinates);
  Eigen::MatrixXd stiffness = inertia;
  Eigen::MatrixXd damping = inertia;
  inertia.topLeftCorner(n, n) = M;
  if (viscous_friction.size() > 0) damping.diagonal().head(n) = viscous_friction;
  if (flexible != nullptr) {
    inertia.diagonal().tail(n) = flexible->rotor_inertia;
    if (flexible->motor_damping.size() > 0) damping.diagonal().tail(n) = flexible->motor_damping;
    const Eigen::MatrixXd K = Eigen::VectorXd(flexible->stiffness).asDiagonal();
    stiffness << K, -K, -K, K;
  }
  const Eigen::LLT<Eigen::MatrixXd> llt(inertia);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(2 * coordinates, 2 * coordinates);
  A.topRightCorner(coordinates, coordinates).setIdentity();
  A.bottomLeftCorner(coordinates, coordinates) = -llt.solve(stiffness);
  A.bottomRightCorner(coordinates, coordinates) = -llt.solve(damping);
  return Eigen::EigenSolver<Eigen::MatrixXd>(A, false).eigenvalues().cwiseAbs().maxCoeff();
}

double integrator_steps(Integrator method, double rate, double interval_s) {
  const auto steps = [&](double stable) {
    return std::max(1.0, std::ceil(rate * interval_s / stable));
  };
  // Largest y for which the method is stable on i y.
  switch (method) {
    case Integrator::runge_kutta_merson:
      return steps(3.4);
    case Integrator::runge_kutta_3:
      return steps(1.7);
    case Integrator::runge_kutta_feldberg:
      return steps(1.0);  // slightly unstable all along the axis: error control holds it here
    case Integrator::semi_explicit_euler_2:
    case Integrator::verlet:
      return steps(2.0);
    case Integrator::cpodes:
      return 1;
  }
  throw std::logic_error("plant: unknown integrator");
}

}  // namespace tachless::plant
