#include "reference/trajectory/waypoints.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace tachless::reference::trajectory {
namespace {

enum class Kind { first, inner, last, only };

/// Polynomial of one joint over one piece in x in [0, 1], from what is known at its ends. `v` and
/// `a` are scaled by T and T^2. The first piece is at rest at its beginning, the last, which runs
/// in mirrored time, at its end.
using Coefficients = std::array<double, 10>;

/// At rest through snap at x = 0 (position q0); position, velocity, acceleration at x = 1.
Coefficients from_rest(double q0, double q1, double v1, double a1) {
  const double d = q1 - q0;
  return {
      q0, 0, 0, 0, 0, 21 * d - 6 * v1 + a1 / 2, -35 * d + 11 * v1 - a1, 15 * d - 5 * v1 + a1 / 2,
      0,  0};
}

/// Quintic Hermite polynomial.
Coefficients between(double q0, double v0, double a0, double q1, double v1, double a1) {
  const double d = q1 - q0 - v0 - a0 / 2;
  const double e = v1 - v0 - a0;
  const double f = a1 - a0;
  return {q0, v0, a0 / 2, 10 * d - 4 * e + f / 2, -15 * d + 7 * e - f, 6 * d - 3 * e + f / 2, 0,
          0,  0,  0};
}

Coefficients rest_to_rest(double q0, double q1) {
  const double d = q1 - q0;
  return {q0, 0, 0, 0, 0, 126 * d, -420 * d, 540 * d, -315 * d, 70 * d};
}

Coefficients piece(Kind kind, double q0, double v0, double a0, double q1, double v1, double a1) {
  switch (kind) {
    case Kind::first:
      return from_rest(q0, q1, v1, a1);
    case Kind::inner:
      return between(q0, v0, a0, q1, v1, a1);
    case Kind::last:
      return from_rest(q1, q0, -v0, a0);
    case Kind::only:
      return rest_to_rest(q0, q1);
  }
  throw std::logic_error("waypoints: no such kind of piece");
}

/// The `order`-th derivative with respect to x of sum c_k x^k.
double derivative(const Coefficients& c, int order, double x) {
  double sum = 0;
  for (int k = static_cast<int>(c.size()) - 1; k >= order; --k) {
    double factor = 1;
    for (int j = 0; j < order; ++j) {
      factor *= k - j;
    }
    sum = sum * x + factor * c[k];
  }
  return sum;
}

Kind kind_of(std::size_t i, std::size_t num_pieces) {
  if (num_pieces == 1) {
    return Kind::only;
  }
  if (i == 0) {
    return Kind::first;
  }
  return i + 1 == num_pieces ? Kind::last : Kind::inner;
}

int degree(Kind kind) {
  switch (kind) {
    case Kind::inner:
      return 5;
    case Kind::first:
    case Kind::last:
      return 7;
    case Kind::only:
      return 9;
  }
  throw std::logic_error("waypoints: no such kind of piece");
}

void check(const std::vector<double>& time_s, const std::vector<robot::Vector>& position) {
  std::ostringstream problem;
  if (time_s.size() < 2 || time_s.size() != position.size()) {
    problem << time_s.size() << " times and " << position.size()
            << " positions; needed: two or more of each, as many of one as of the other";
    throw std::invalid_argument(problem.str());
  }
  for (std::size_t i = 0; i + 1 < time_s.size(); ++i) {
    if (!(time_s[i] < time_s[i + 1])) {
      problem << "time " << i + 2 << " (" << time_s[i + 1] << " s) is not after time " << i + 1
              << " (" << time_s[i] << " s); allowed: strictly increasing";
      throw std::invalid_argument(problem.str());
    }
  }
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (position[i].size() != position.front().size()) {
      problem << "position " << i + 1 << " has " << position[i].size() << " entries, the first "
              << position.front().size() << "; needed: one per joint";
      throw std::invalid_argument(problem.str());
    }
  }
}

}  // namespace

Waypoints::Waypoints(std::vector<double> time_s, const std::vector<robot::Vector>& position)
    : time_s_(std::move(time_s)) {
  check(time_s_, position);
  first_ = position.front();
  last_ = position.back();
  const std::size_t num_pieces = time_s_.size() - 1;
  const Eigen::Index num_inner = static_cast<Eigen::Index>(num_pieces) - 1;
  const Eigen::Index num_joints = first_.size();
  const double scale = (time_s_.back() - time_s_.front()) / static_cast<double>(num_pieces);

  // Unknown: velocity and acceleration at the inner points (scaled by the mean duration so that
  // they are of one size). Known: jerk and snap agree from both sides there. A piece is linear in
  // its end values, so its part of the equations is read off from unit values.
  Eigen::MatrixXd equations = Eigen::MatrixXd::Zero(2 * num_inner, 2 * num_inner);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(2 * num_inner, num_joints);
  for (std::size_t i = 0; i < num_pieces; ++i) {
    const Kind kind = kind_of(i, num_pieces);
    const double ratio = (time_s_[i + 1] - time_s_[i]) / scale;
    const bool mirrored = kind == Kind::last;
    for (const bool at_end : {false, true}) {
      const Eigen::Index point = static_cast<Eigen::Index>(i) - 1 + (at_end ? 1 : 0);
      if (point < 0 || point >= num_inner) {
        continue;
      }
      const double x = at_end != mirrored ? 1 : 0;
      for (const int order : {3, 4}) {
        const Eigen::Index row = 2 * point + (order - 3);
        // The difference "from the left minus from the right" must vanish.
        const double sign = (at_end ? 1 : -1) * (mirrored && order == 3 ? -1 : 1);
        const double weight = sign / std::pow(ratio, order);
        const auto response = [&](double q0, double v0, double a0, double q1, double v1,
                                  double a1) {
          return weight * derivative(piece(kind, q0, v0 * ratio, a0 * ratio * ratio, q1, v1 * ratio,
                                           a1 * ratio * ratio),
                                     order, x);
        };
        if (i > 0) {
          equations(row, 2 * static_cast<Eigen::Index>(i) - 2) += response(0, 1, 0, 0, 0, 0);
          equations(row, 2 * static_cast<Eigen::Index>(i) - 1) += response(0, 0, 1, 0, 0, 0);
        }
        if (i + 1 < num_pieces) {
          equations(row, 2 * static_cast<Eigen::Index>(i)) += response(0, 0, 0, 0, 1, 0);
          equations(row, 2 * static_cast<Eigen::Index>(i) + 1) += response(0, 0, 0, 0, 0, 1);
        }
        // A constant has no jerk, so only the difference of the positions counts.
        right.row(row) -= response(0, 0, 0, 1, 0, 0) * (position[i + 1] - position[i]).transpose();
      }
    }
  }
  Eigen::MatrixXd inner(2 * num_inner, num_joints);
  if (num_inner > 0) {
    inner = equations.partialPivLu().solve(right);
  }

  const auto unknown = [&](std::size_t point, int which, Eigen::Index joint) {
    if (point == 0 || point == num_pieces) {
      return 0.0;
    }
    return inner(2 * static_cast<Eigen::Index>(point) - 2 + which, joint);
  };
  for (std::size_t i = 0; i < num_pieces; ++i) {
    const Kind kind = kind_of(i, num_pieces);
    Piece made;
    made.duration_s = time_s_[i + 1] - time_s_[i];
    made.mirrored = kind == Kind::last;
    made.num_coefficients = degree(kind) + 1;
    made.c.fill(robot::Vector::Zero(num_joints));
    const double ratio = made.duration_s / scale;
    for (Eigen::Index joint = 0; joint < num_joints; ++joint) {
      const Coefficients c =
          piece(kind, position[i][joint], unknown(i, 0, joint) * ratio,
                unknown(i, 1, joint) * ratio * ratio, position[i + 1][joint],
                unknown(i + 1, 0, joint) * ratio, unknown(i + 1, 1, joint) * ratio * ratio);
      for (std::size_t k = 0; k < c.size(); ++k) {
        made.c[k][joint] = c[k];
      }
    }
    pieces_.push_back(made);
  }
}

loop::ReferencePoint Waypoints::at(double t_s) const {
  const robot::Vector zero = robot::Vector::Zero(first_.size());
  if (t_s <= time_s_.front()) {
    return {first_, zero, zero, zero, zero};
  }
  if (t_s >= time_s_.back()) {
    return {last_, zero, zero, zero, zero};
  }
  const auto after = std::upper_bound(time_s_.begin(), time_s_.end(), t_s);
  const auto i = static_cast<std::size_t>(after - time_s_.begin()) - 1;
  const Piece& p = pieces_[i];
  const double x = (p.mirrored ? time_s_[i + 1] - t_s : t_s - time_s_[i]) / p.duration_s;
  const double rate = (p.mirrored ? -1 : 1) / p.duration_s;

  loop::ReferencePoint point{zero, zero, zero, zero, zero};
  // Horner's scheme for the polynomial and its first four derivatives divided by their factorials.
  for (int k = p.num_coefficients - 1; k >= 0; --k) {
    point.snap_ref = point.snap_ref * x + point.jerk_ref;
    point.jerk_ref = point.jerk_ref * x + point.a_ref;
    point.a_ref = point.a_ref * x + point.v_ref;
    point.v_ref = point.v_ref * x + point.q_ref;
    point.q_ref = point.q_ref * x + p.c[k];
  }
  point.v_ref *= rate;
  point.a_ref *= 2 * rate * rate;
  point.jerk_ref *= 6 * rate * rate * rate;
  point.snap_ref *= 24 * rate * rate * rate * rate;
  return point;
}

}  // namespace tachless::reference::trajectory
