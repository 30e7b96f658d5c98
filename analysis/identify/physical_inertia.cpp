#include "identify/physical_inertia.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int most_steps = 200;
constexpr double prior = 0.5;  ///< standard deviation
/// Standard deviations of a load's mass [kg] and of its other numbers [kg m; kg m2] about zero.
/// They keep numbers that have no part in any torque at zero.
constexpr double load_mass = 100, load_moment = 1;
constexpr double smallest = 0.01;  ///< mass [kg] and length [m] that a body without mass gets

/// A body's U as ten numbers: the logarithm of its scale, the logarithms of three lengths, the
/// entries 12, 23 and 13, and the last column. Lengths are multiples of the body's own length.
struct Shape {
  Inertial numbers;
  double length = 1;  ///< [m]

  [[nodiscard]] Inertial inertial(const Inertial& at) const {
    Matrix4d U = Matrix4d::Zero();
    U.diagonal() << length * at.segment<3>(1).array().exp().matrix(), 1;
    U(0, 1) = length * at[4];
    U(1, 2) = length * at[5];
    U(0, 2) = length * at[6];
    U.topRightCorner<3, 1>() = length * at.tail<3>();
    U *= std::exp(at[0]);
    const Matrix4d P = U * U.transpose();
    const Matrix3d I =
        P.topLeftCorner<3, 3>().trace() * Matrix3d::Identity() - P.topLeftCorner<3, 3>();
    Inertial value;
    value << P(3, 3), P.topRightCorner<3, 1>(), I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2),
        I(1, 2);
    return value;
  }
  [[nodiscard]] Eigen::Matrix<double, 10, 10> derivative(const Inertial& at) const {
    constexpr double step = 1e-6;
    Eigen::Matrix<double, 10, 10> result;
    for (Index i = 0; i < 10; ++i) {
      const Inertial by = step * Inertial::Unit(i);
      result.col(i) = (inertial(at + by) - inertial(at - by)) / (2 * step);
    }
    return result;
  }
};

/// Returns the shape of a body. Adds to the inertia of a point, of nothing or of an impossible body
/// until U exists.
Shape shape_of(const robot::MassProperties& body) {
  const Inertial own = inertial_of(body);
  Matrix3d I;
  I << own[4], own[7], own[8], own[7], own[5], own[9], own[8], own[9], own[6];
  Matrix4d P;
  P << 0.5 * I.trace() * Matrix3d::Identity() - I, own.segment<3>(1), own.segment<3>(1).transpose(),
      own[0];
  if (own[0] < 1e-6) P(3, 3) = smallest;
  constexpr double most = 1e30;  // far more than any finite matrix needs
  for (double more = 1e-6; more < most; more *= 2) {
    P.diagonal().head<3>().array() += more * P(3, 3) * smallest * smallest;
    // The lower factor of the reversed matrix is upper triangular after a second reversal.
    const Eigen::LLT<Matrix4d> factor(P.reverse());
    if (factor.info() != Eigen::Success) continue;
    const Matrix4d U = MatrixXd(factor.matrixL()).reverse();
    Shape shape;
    shape.length = U.diagonal().head<3>().maxCoeff() / U(3, 3);
    const Matrix4d unit = U / (U(3, 3) * shape.length);
    shape.numbers << std::log(U(3, 3)), unit.diagonal().head<3>().array().log().matrix(),
        unit(0, 1), unit(1, 2), unit(0, 2), unit.topRightCorner<3, 1>();
    return shape;
  }
  throw std::domain_error("a body's inertia is not a number");
}

/// Takes parameter i out of the Newton step H x = slope.
void hold(Index i, MatrixXd& H, VectorXd& slope) {
  const double own = H(i, i);
  H.row(i).setZero();
  H.col(i).setZero();
  H(i, i) = own;
  slope[i] = 0;
}

/// Returns rows R with R'R = C^-1 for the covariance C = variance J J'. A link near the
/// boundary of the possible ones has hardly any variance in some direction; a hundredth of each
/// number's own standard deviation is added.
MatrixXd rows_of_prior(const MatrixXd& J, double variance) {
  constexpr double least = 1e-4;
  MatrixXd C = variance * J * J.transpose();
  C.diagonal() *= 1 + least;
  const VectorXd unit = C.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::LLT<MatrixXd> factor(unit.asDiagonal() * C * unit.asDiagonal());
  return factor.matrixL().solve(MatrixXd(unit.asDiagonal()));
}

}  // namespace

PossibleValues possible_values(const MatrixXd& N, const VectorXd& b, const Parameters& parameters,
                               const robot::Model& model) {
  const Index size = b.size(), links = parameters.first(Kind::inertia);
  std::vector<Shape> shapes;
  VectorXd z = VectorXd::Zero(size), stiffness = VectorXd::Zero(size);
  for (const robot::Body& body : model.bodies) {
    if (links < 0) break;
    shapes.push_back(shape_of(body));
    z.segment<10>(links + 10 * (std::ssize(shapes) - 1)) = shapes.back().numbers;
  }
  if (links >= 0)
    stiffness.segment(links, 10 * std::ssize(shapes)).setConstant(1 / (prior * prior));
  if (const Index load = parameters.first(Kind::load); load >= 0) {
    stiffness.segment<10>(load).setConstant(1 / (load_moment * load_moment));
    stiffness[load] = 1 / (load_mass * load_mass);
  }
  const VectorXd first = z;
  const auto for_each_body = [&](const auto& act) {
    for (std::size_t i = 0; i < shapes.size(); ++i) act(i, links + 10 * static_cast<Index>(i));
  };
  const auto values_at = [&](const VectorXd& at) {
    VectorXd x = at;
    for_each_body([&](std::size_t i, Index from) {
      x.segment<10>(from) = shapes[i].inertial(at.segment<10>(from)) - inertial_of(model.bodies[i]);
    });
    return x;
  };
  const auto cost = [&](const VectorXd& at) {
    const VectorXd x = values_at(at);
    return 0.5 * x.dot(N * x) - b.dot(x) + 0.5 * (at - first).cwiseAbs2().dot(stiffness);
  };
  const auto not_negative = [&](Index i) {
    return parameters.entries()[static_cast<std::size_t>(i)].not_negative;
  };
  const auto bounded = [&](VectorXd at) {
    for (Index i = 0; i < size; ++i) {
      if (not_negative(i)) at[i] = std::max(0.0, at[i]);
    }
    return at;
  };
  double now = cost(z), damping = 1e-6;
  for (int step = 0; step < most_steps && damping < 1e12; ++step) {
    MatrixXd J = MatrixXd::Identity(size, size);
    for_each_body([&](std::size_t i, Index from) {
      J.block<10, 10>(from, from) = shapes[i].derivative(z.segment<10>(from));
    });
    MatrixXd H = J.transpose() * N * J;
    H.diagonal() += stiffness;
    VectorXd slope = J.transpose() * (b - N * values_at(z)) - stiffness.cwiseProduct(z - first);
    // A parameter that stays at its bound has no part in the step of the others.
    for (Index i = 0; i < size; ++i) {
      if (not_negative(i) && z[i] <= 0 && slope[i] <= 0) hold(i, H, slope);
    }
    const VectorXd unit = H.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    H = unit.asDiagonal() * H * unit.asDiagonal();
    H.diagonal().setConstant(1 + damping);
    const VectorXd next = bounded(z + unit.cwiseProduct(H.ldlt().solve(unit.cwiseProduct(slope))));
    const double there = cost(next);
    if (!(there < now)) {
      damping = std::max(1e-6, 10 * damping);
      continue;
    }
    const bool small = now - there < 1e-12 * std::abs(now);
    z = next;
    now = there;
    if (small) break;
    damping /= 10;
  }
  MatrixXd known = stiffness.cwiseSqrt().asDiagonal();
  for_each_body([&](std::size_t i, Index from) {
    known.block<10, 10>(from, from) =
        rows_of_prior(shapes[i].derivative(z.segment<10>(from)), prior * prior);
  });
  std::vector<Index> rows;
  for (Index i = 0; i < size; ++i) {
    if (stiffness[i] > 0) rows.push_back(i);
  }
  return {values_at(z), known(rows, Eigen::all)};
}

}  // namespace tachless::identify
