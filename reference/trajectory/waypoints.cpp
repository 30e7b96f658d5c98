#include "reference/trajectory/waypoints.h"

#include <fmt/format.h>

#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
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
    for (int j = 0; j < order; ++j) factor *= k - j;
    sum = sum * x + factor * c[k];
  }
  return sum;
}

Kind kind_of(std::size_t i, std::size_t num_pieces) {
  if (num_pieces == 1) return Kind::only;
  if (i == 0) return Kind::first;
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

/// The linear equations for velocity and acceleration at the inner points (scaled by the mean
/// duration so that they are of one size): jerk and snap agree from both sides there. A piece is
/// linear in its end values, so its part of the equations is read off from unit values.
class Equations {
 public:
  explicit Equations(const Waypoints& points)
      : points_(points),
        num_pieces_(points.time_s.size() - 1),
        scale_((points.time_s.back() - points.time_s.front()) / static_cast<double>(num_pieces_)),
        right_(Eigen::MatrixXd::Zero(num_unknowns(), points.position_rad.front().size())) {
    for (std::size_t i = 0; i < num_pieces_; ++i) {
      if (i > 0) add_end(i, false);
      if (i + 1 < num_pieces_) add_end(i, true);
    }
  }

  /// Row 2 k: velocity at point k + 1, row 2 k + 1: acceleration there; one column per joint.
  [[nodiscard]] Eigen::MatrixXd solution() const {
    if (num_unknowns() == 0) return right_;
    Eigen::SparseMatrix<double> matrix(num_unknowns(), num_unknowns());
    matrix.setFromTriplets(entries_.begin(), entries_.end());
    const Eigen::SparseLU<Eigen::SparseMatrix<double>> lu(matrix);
    if (lu.info() != Eigen::Success) throw std::logic_error("waypoints: " + lu.lastErrorMessage());
    return lu.solve(right_);
  }

  [[nodiscard]] double scale() const { return scale_; }

 private:
  [[nodiscard]] Eigen::Index num_unknowns() const {
    return 2 * (static_cast<Eigen::Index>(num_pieces_) - 1);
  }

  /// What piece `i` says about jerk and snap at its beginning or at its end.
  void add_end(std::size_t i, bool at_end) {
    const Kind kind = kind_of(i, num_pieces_);
    const double ratio = (points_.time_s[i + 1] - points_.time_s[i]) / scale_;
    const bool mirrored = kind == Kind::last;
    const double x = at_end != mirrored ? 1 : 0;
    const auto before = 2 * static_cast<Eigen::Index>(i) - 2;  // unknowns at the beginning
    const Eigen::Index after = before + 2;
    for (const int order : {3, 4}) {
      const Eigen::Index row = (at_end ? after : before) + (order - 3);
      // The difference "from the left minus from the right" must vanish.
      const double sign = (at_end ? 1 : -1) * (mirrored && order == 3 ? -1 : 1);
      const double weight = sign / std::pow(ratio, order);
      const auto response = [&](double q0, double v0, double a0, double q1, double v1, double a1) {
        return weight * derivative(piece(kind, q0, v0 * ratio, a0 * ratio * ratio, q1, v1 * ratio,
                                         a1 * ratio * ratio),
                                   order, x);
      };
      if (i > 0) {
        entries_.emplace_back(row, before, response(0, 1, 0, 0, 0, 0));
        entries_.emplace_back(row, before + 1, response(0, 0, 1, 0, 0, 0));
      }
      if (i + 1 < num_pieces_) {
        entries_.emplace_back(row, after, response(0, 0, 0, 0, 1, 0));
        entries_.emplace_back(row, after + 1, response(0, 0, 0, 0, 0, 1));
      }
      // A constant has no jerk, so only the difference of the positions counts.
      right_.row(row) -= response(0, 0, 0, 1, 0, 0) *
                         (points_.position_rad[i + 1] - points_.position_rad[i]).transpose();
    }
  }

  const Waypoints& points_;
  std::size_t num_pieces_;
  double scale_;
  std::vector<Eigen::Triplet<double>> entries_;
  Eigen::MatrixXd right_;
};

}  // namespace

std::optional<schema::Refusal> Waypoints::refusal() const {
  if (time_s.size() < 2) {
    return {{"time_s", fmt::format("{} times; allowed: at least 2", time_s.size())}};
  }
  for (std::size_t i = 1; i < time_s.size(); ++i) {
    if (!(time_s[i - 1] < time_s[i])) {
      return {
          {"time_s", fmt::format("time {} ({} s) is not after time {} ({} s); allowed: strictly "
                                 "increasing times",
                                 i + 1, time_s[i], i, time_s[i - 1])}};
    }
  }
  if (position_rad.size() != time_s.size()) {
    return {{"position_rad", fmt::format("{} positions; allowed: {}, one per time",
                                         position_rad.size(), time_s.size())}};
  }
  for (const robot::Vector& position : position_rad) {
    if (position.size() != position_rad.front().size()) {
      return {{"position_rad", fmt::format("a position with {} entries, the first has {}; allowed: "
                                           "one per joint",
                                           position.size(), position_rad.front().size())}};
    }
  }
  return std::nullopt;
}

WaypointSpline::WaypointSpline(const Waypoints& points) : time_s_(points.time_s) {
  if (const auto refused = points.refusal()) {
    throw std::invalid_argument(refused->key + ": " + refused->problem);
  }
  const std::vector<robot::Vector>& position = points.position_rad;
  first_ = position.front();
  last_ = position.back();
  const Equations equations(points);
  const Eigen::MatrixXd inner = equations.solution();
  const std::size_t num_pieces = time_s_.size() - 1;

  const auto unknown = [&](std::size_t point, int which, Eigen::Index joint) {
    if (point == 0 || point == num_pieces) return 0.0;
    return inner(2 * static_cast<Eigen::Index>(point) - 2 + which, joint);
  };
  pieces_.resize(num_pieces);
  for (std::size_t i = 0; i < num_pieces; ++i) {
    const Kind kind = kind_of(i, num_pieces);
    Piece& made = pieces_[i];
    made.duration_s = time_s_[i + 1] - time_s_[i];
    made.mirrored = kind == Kind::last;
    made.num_coefficients = degree(kind) + 1;
    made.c.fill(robot::Vector::Zero(first_.size()));
    const double ratio = made.duration_s / equations.scale();
    for (Eigen::Index joint = 0; joint < first_.size(); ++joint) {
      const Coefficients c =
          piece(kind, position[i][joint], unknown(i, 0, joint) * ratio,
                unknown(i, 1, joint) * ratio * ratio, position[i + 1][joint],
                unknown(i + 1, 0, joint) * ratio, unknown(i + 1, 1, joint) * ratio * ratio);
      for (std::size_t k = 0; k < c.size(); ++k) made.c[k][joint] = c[k];
    }
  }
}

loop::ReferencePoint WaypointSpline::at(double t_s) const {
  const robot::Vector zero = robot::Vector::Zero(first_.size());
  if (t_s <= time_s_.front()) return {first_, zero, zero, zero, zero};
  if (t_s >= time_s_.back()) return {last_, zero, zero, zero, zero};
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
