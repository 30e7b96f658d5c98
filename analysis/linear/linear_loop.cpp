#include "linear/linear_loop.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "numerics/decompositions.h"
#include "robot/dynamics.h"
#include "robot/jet.h"

namespace tachless::linear {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd power(MatrixXd base, std::int64_t exponent) {
  MatrixXd result = MatrixXd::Identity(base.rows(), base.cols());
  for (; exponent > 0; exponent /= 2) {
    if (exponent % 2 == 1) result = base * result;
    base = base * base;
  }
  return result;
}

messages::ReferencePoint constant_reference(const Vector& q) {
  const Vector zero = Vector::Zero(q.size());
  return {q, zero, zero, zero, zero};
}

MatrixXd gradient_by_q(const robot::Model& model, const messages::ReferencePoint& r) {
  const int n = model.num_joints;
  const Vector zero = Vector::Zero(n);
  const robot::JetVector v = robot::jet(r.v_ref, zero, zero), a = robot::jet(r.a_ref, zero, zero);
  MatrixXd gradient(n, n);
  for (int j = 0; j < n; ++j) {
    gradient.col(j) = robot::first_derivative(
        robot::inverse_dynamics(model, robot::jet(r.q_ref, Vector::Unit(n, j), zero), v, a));
  }
  return gradient;
}

LinearPlant rigid_plant(const robot::Model& model, const messages::ReferencePoint& r,
                        const VectorXd& friction) {
  MatrixXd damping = 2 * robot::coriolis_matrix(model, r.q_ref, r.v_ref);
  const Index n = model.num_joints;
  if (friction.size() > 0) damping.diagonal() += friction;
  const MatrixXd inertia = robot::mass_matrix(model, r.q_ref);
  const Eigen::LDLT<MatrixXd> M(inertia);
  LinearPlant plant{MatrixXd::Zero(2 * n, 2 * n), MatrixXd::Zero(2 * n, n), n};
  plant.A.topRightCorner(n, n).setIdentity();
  plant.A.bottomLeftCorner(n, n) = -M.solve(gradient_by_q(model, r));
  plant.A.bottomRightCorner(n, n) = -M.solve(damping);
  plant.B.bottomRows(n) = M.solve(MatrixXd::Identity(n, n));
  return plant;
}

LinearPlant flexible_plant(const robot::Model& links, const messages::ReferencePoint& r,
                           const VectorXd& stiffness, const VectorXd& rotor_inertia,
                           const VectorXd& friction, const VectorXd& spring_damping) {
  const Index n = links.num_joints;
  const LinearPlant rigid = rigid_plant(links, r);
  const MatrixXd& inverse_M = rigid.B.bottomRows(n);
  const MatrixXd K = stiffness.asDiagonal();
  LinearPlant plant{MatrixXd::Zero(4 * n, 4 * n), MatrixXd::Zero(4 * n, n), n};
  plant.A.topLeftCorner(2 * n, 2 * n) = rigid.A;
  plant.A.block(n, 0, n, n) -= inverse_M * K;
  plant.A.block(n, 2 * n, n, n) = inverse_M * K;
  plant.A.block(2 * n, 3 * n, n, n).setIdentity();
  const VectorXd by_J = stiffness.cwiseQuotient(rotor_inertia);
  plant.A.block(3 * n, 0, n, n) = by_J.asDiagonal();
  plant.A.block(3 * n, 2 * n, n, n) = (-by_J).asDiagonal();
  if (friction.size() > 0) {
    plant.A.block(3 * n, 3 * n, n, n) = (-friction.cwiseQuotient(rotor_inertia)).asDiagonal();
  }
  if (spring_damping.size() > 0) {
    const MatrixXd D = spring_damping.asDiagonal();
    const MatrixXd by_rotors = spring_damping.cwiseQuotient(rotor_inertia).asDiagonal();
    plant.A.block(n, n, n, n) -= inverse_M * D;
    plant.A.block(n, 3 * n, n, n) += inverse_M * D;
    plant.A.block(3 * n, n, n, n) += by_rotors;
    plant.A.block(3 * n, 3 * n, n, n) -= by_rotors;
  }
  plant.B.bottomRows(n) = rotor_inertia.cwiseInverse().asDiagonal();
  return plant;
}

LinearLaw linearised(const controller::law::LawStep& law, const VectorXd& memory,
                     const VectorXd& measurement, std::vector<Part> measured, double step) {
  const Index m = memory.size(), y = measurement.size();
  VectorXd x(m + y);
  x << memory, measurement;
  MatrixXd next(m, m + y), torque;
  for (Index i = 0; i < m + y; ++i) {
    const double h = step * std::max(1.0, std::abs(x[i]));
    const auto at = [&](double offset) {
      VectorXd shifted = x;
      shifted[i] += offset;
      return law(shifted.head(m), shifted.tail(y));
    };
    const auto plus = at(h), minus = at(-h);
    if (torque.size() == 0) torque.resize(plus.second.size(), m + y);
    next.col(i) = (plus.first - minus.first) / (2 * h);
    torque.col(i) = (plus.second - minus.second) / (2 * h);
  }
  return {next.leftCols(m), next.rightCols(y), torque.leftCols(m), torque.rightCols(y),
          std::move(measured)};
}

MatrixXd first_memory(const LinearLaw& law, const MatrixXd& measured) {
  const Index m = law.A.rows();
  if (law.start.size() > 0) return law.start * measured;
  if (m == 0) return MatrixXd::Zero(0, measured.cols());
  const auto at_rest = numerics::solution(MatrixXd::Identity(m, m) - law.A, law.B * measured);
  return at_rest ? MatrixXd(*at_rest) : MatrixXd::Zero(m, measured.cols());
}

MatrixXd measured_rows(const std::vector<Part>& measured, Index n, Index states) {
  MatrixXd C = MatrixXd::Zero(n * std::ssize(measured), states);
  for (std::size_t i = 0; i < measured.size(); ++i) {
    C.block(static_cast<Index>(i) * n, static_cast<Index>(measured[i]) * n, n, n).setIdentity();
  }
  return C;
}

namespace {

/// Returns `held` of a plant with a loop inside the drives: R^(N-r) X R^r, where R is one tick of
/// the drives and X puts the new torque into use.
LinearPlant held_by_drives(const LinearPlant& plant, double period_s) {
  const DriveTicks& drive = *plant.drive;
  const Index n = plant.num_joints;
  const Index ticks = std::max<Index>(1, std::llround(period_s / drive.period_s));
  const Index late =
      std::min<Index>(ticks - 1, std::llround(drive.late * static_cast<double>(ticks)));
  const MatrixXd tick =
      numerics::exponential(plant.A * (period_s / static_cast<double>(ticks))) * drive.jump;
  MatrixXd before = power(tick, late);
  before.bottomRows(n).setZero();
  const MatrixXd after = power(tick, ticks - late);
  return {after * before, after.rightCols(n), n};
}

}  // namespace

LinearPlant held(const LinearPlant& plant, double period_s) {
  if (plant.drive) return held_by_drives(plant, period_s);
  const Index m = plant.A.rows(), n = plant.B.cols();
  MatrixXd joined = MatrixXd::Zero(m + n, m + n);
  joined.topLeftCorner(m, m) = plant.A * period_s;
  joined.topRightCorner(m, n) = plant.B * period_s;
  const MatrixXd exponential = numerics::exponential(joined);
  return {exponential.topLeftCorner(m, m), exponential.topRightCorner(m, n), plant.num_joints};
}

MatrixXd CutLoop::closed(double gain) const { return A + gain * B * C; }

CutLoop cut(const LinearPlant& plant, const LinearLaw& law, double period_s, int delay) {
  const LinearPlant step = held(plant, period_s);
  const MatrixXd measured = measured_rows(law.measured, plant.num_joints, plant.A.rows());
  const Index x = plant.A.rows(), s = law.A.rows(), n = plant.B.cols(), all = x + s + delay * n;
  CutLoop loop{MatrixXd::Zero(all, all), MatrixXd::Zero(all, n), MatrixXd::Zero(n, all)};
  loop.A.block(0, 0, x, x) = step.A;
  loop.A.block(x, 0, s, x) = law.B * measured;
  loop.A.block(x, x, s, s) = law.A;
  if (delay == 0) {
    loop.B.topRows(x) = step.B;
  } else {
    loop.A.block(0, x + s + (delay - 1) * n, x, n) = step.B;
    loop.B.middleRows(x + s, n).setIdentity();
  }
  for (int i = 1; i < delay; ++i) {
    loop.A.block(x + s + i * n, x + s + (i - 1) * n, n, n).setIdentity();
  }
  loop.C.leftCols(x) = law.D * measured;
  loop.C.middleCols(x, s) = law.C;
  if (law.compensation.size() > 0) {
    const MatrixXd kept = law.compensation * measured;
    loop.C.leftCols(x) -= kept;
    loop.A.leftCols(x) += loop.B * kept;
  }
  return loop;
}

}  // namespace tachless::linear
