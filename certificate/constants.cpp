#include "certificate/constants.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "certificate/optimise.h"
#include "certificate/parallel.h"
#include "robot/inverse_dynamics.h"
#include "robot/jet.h"

namespace tachless::certificate {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using robot::Vector;

/// What a constant takes of C(q, x).
using PartOfC = MatrixXd (*)(const MatrixXd&);
MatrixXd whole(const MatrixXd& C) { return C; }
MatrixXd skew(const MatrixXd& C) { return C.transpose() - C; }
MatrixXd symmetric(const MatrixXd& C) { return (C + C.transpose()) / 2; }

/// sup over |x| = 1 of the norm of sum_j x_j C_j, the largest value of the trilinear form u'C(x)w
/// on unit vectors: by alternating power iteration from several directions, hence from below.
double largest_over_directions(const std::vector<MatrixXd>& C) {
  const auto n = static_cast<Eigen::Index>(C.size());
  double best = 0;
  for (Eigen::Index start = 0; start < n; ++start) {
    VectorXd x = VectorXd::Unit(n, start) + VectorXd::Constant(n, 0.1);
    VectorXd w = VectorXd::LinSpaced(n, 1, 0.3);  // along no eigenvector in particular
    double value = 0;
    for (int iteration = 0; iteration < 300; ++iteration) {
      MatrixXd sum = MatrixXd::Zero(n, n);
      for (Eigen::Index j = 0; j < n; ++j) sum += x[j] * C[static_cast<std::size_t>(j)];
      w.noalias() = (sum.transpose() * (sum * w)).eval();
      if (!(w.norm() > 0)) break;
      w.normalize();
      const VectorXd u = (sum * w).normalized();
      for (Eigen::Index j = 0; j < n; ++j) x[j] = u.dot(C[static_cast<std::size_t>(j)] * w);
      const double norm = x.norm();  // u'C(x)w at the best x
      if (!(norm > 0)) break;
      x /= norm;
      if (norm <= value * (1 + 1e-13)) break;
      value = norm;
    }
    best = std::max(best, value);
  }
  return best;
}

std::vector<MatrixXd> parts(const Inertia& inertia, PartOfC part) {
  std::vector<MatrixXd> result;
  for (const MatrixXd& C : inertia.C) result.push_back(part(C));
  return result;
}

double joint_norm(const std::vector<MatrixXd>& C) {
  double sum = 0;
  for (const MatrixXd& c : C) sum += std::pow(spectral_norm(c), 2);
  return std::sqrt(sum);
}

/// How far a function with this norm of its harmonics may leave the chord between grid points.
template <class Norm>
double gap(const Postures& postures, const Norm& norm) {
  double sum = 0;
  for (const auto& h : postures.harmonics()) {
    sum += h.order * h.order * std::hypot(norm(h.cosine), norm(h.sine));
  }
  return postures.chord_factor() * sum;
}

/// Over the unit circle of directions x by a polygon around it, for two joints.
double polygon_bound(const std::vector<MatrixXd>& C) {
  constexpr int half_sides = 180;
  double largest = 0;
  for (int k = 0; k < half_sides; ++k) {
    const double angle = std::numbers::pi * k / half_sides;
    largest = std::max(largest, spectral_norm(std::cos(angle) * C[0] + std::sin(angle) * C[1]));
  }
  return largest / std::cos(std::numbers::pi / (2 * half_sides));
}

Extreme coriolis_constant(const robot::Model& model, const Postures& postures, PartOfC part) {
  Extreme result = largest(
      model,
      [&](const Vector& q) { return largest_over_directions(parts(inertia_at(model, q), part)); },
      postures.kind() == Postures::Kind::sampled ? 256 : 64);
  if (postures.proved() && postures.kind() == Postures::Kind::circle) {
    double on_grid = 0;
    for (std::size_t i = 0; i < postures.size(); ++i) {
      on_grid = std::max(on_grid, polygon_bound(parts(postures.at(i), part)));
    }
    result.bound =
        on_grid + gap(postures, [&](const Inertia& h) { return joint_norm(parts(h, part)); });
  }
  result.proved = postures.proved();
  return result;
}

Extreme inertia_constant(const robot::Model& model, const Postures& postures, double sign) {
  const auto value = [&](const MatrixXd& M) { return largest_eigenvalue(sign * M); };
  Extreme result = largest(
      model, [&](const Vector& q) { return value(inertia_at(model, q).M); },
      postures.kind() == Postures::Kind::sampled ? 2048 : 64);
  if (postures.proved()) {
    result.bound = value(postures.at(0).M);
    for (std::size_t i = 1; i < postures.size(); ++i) {
      result.bound = std::max(result.bound, value(postures.at(i).M));
    }
    result.bound += gap(postures, [](const Inertia& h) { return spectral_norm(h.M); });
  }
  result.proved = postures.proved();
  result.value *= sign;
  result.bound *= sign;
  return result;
}

}  // namespace

double spectral_norm(const MatrixXd& A) {
  return std::sqrt(std::max(0.0, largest_eigenvalue(A.transpose() * A)));
}

double smallest_eigenvalue(const MatrixXd& symmetric_matrix) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(symmetric_matrix, Eigen::EigenvaluesOnly)
      .eigenvalues()[0];
}

double largest_eigenvalue(const MatrixXd& symmetric_matrix) {
  return -smallest_eigenvalue(-symmetric_matrix);
}

MatrixXd gravity_gradient(const robot::Model& model, const Vector& q) {
  const int n = model.num_joints;
  MatrixXd gradient(n, n);
  const Vector zero = Vector::Zero(n);
  for (int j = 0; j < n; ++j) {
    const Vector unit = Vector::Unit(n, j);
    gradient.col(j) =
        robot::first_derivative(robot::gravity_torque(model, robot::jet(q, unit, zero)));
  }
  return gradient;
}

Extreme largest(const robot::Model& model, const std::function<double(const Vector&)>& f,
                int samples, int starts) {
  std::vector<Vector> q(static_cast<std::size_t>(samples));
  std::vector<double> value(q.size());
  parallel_for(q.size(), [&](std::size_t i) {
    q[i] = spread_posture(model, static_cast<int>(i));
    value[i] = f(q[i]);
  });
  std::vector<std::size_t> order(q.size());
  std::iota(order.begin(), order.end(), 0);
  const auto count = static_cast<std::size_t>(std::min(starts, samples));
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                    [&](std::size_t a, std::size_t b) { return value[a] > value[b]; });
  std::vector<Minimum> refined(count);
  parallel_for(count, [&](std::size_t i) {
    const auto objective = [&](const VectorXd& x) {
      return in_range(model, x) ? -f(x) : std::numeric_limits<double>::infinity();
    };
    refined[i] = minimise(objective, q[order[i]], 0.2, 1000);
  });
  const Minimum& best =
      *std::min_element(refined.begin(), refined.end(),
                        [](const Minimum& a, const Minimum& b) { return a.value < b.value; });
  Vector where = best.x;
  for (int i = 0; i < model.num_joints; ++i) {
    if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) {
      where[i] = std::remainder(where[i], 2 * std::numbers::pi);
    }
  }
  return {-best.value, where, -best.value, false};
}

RobotConstants robot_constants(const robot::Model& model, const Postures& postures) {
  RobotConstants c;
  c.lambda_min_M = inertia_constant(model, postures, -1);
  c.lambda_max_M = inertia_constant(model, postures, +1);
  c.k_c = coriolis_constant(model, postures, whole);
  c.k_s = coriolis_constant(model, postures, skew);
  c.k_y = coriolis_constant(model, postures, symmetric);
  c.sup_g = largest(
      model, [&](const Vector& q) { return robot::gravity_torque(model, q).norm(); }, 1024);
  c.k_g = largest(
      model, [&](const Vector& q) { return spectral_norm(gravity_gradient(model, q)); }, 1024);
  return c;
}

}  // namespace tachless::certificate
