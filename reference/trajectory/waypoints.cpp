#include "reference/trajectory/waypoints.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

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
  Equations(const std::vector<double>& time_s, const Eigen::MatrixXd& position)
      : time_s_(time_s),
        position_(position),
        num_pieces_(time_s.size() - 1),
        scale_((time_s.back() - time_s.front()) / static_cast<double>(num_pieces_)),
        blocks_(num_pieces_ - 1),
        right_(Eigen::MatrixXd::Zero(2 * (static_cast<Eigen::Index>(num_pieces_) - 1),
                                     position.rows())) {
    for (std::size_t i = 0; i < num_pieces_; ++i) {
      if (i > 0) add_end(i, false);
      if (i + 1 < num_pieces_) add_end(i, true);
    }
  }

  /// Row 2 k: velocity at point k + 1, row 2 k + 1: acceleration there; one column per joint. By
  /// elimination from block to block: each has only its neighbours' unknowns beside its own.
  Eigen::MatrixXd solution() {
    const auto num_blocks = static_cast<Eigen::Index>(blocks_.size());
    const auto block = [&](Eigen::Index k) -> Block& {
      return blocks_[static_cast<std::size_t>(k)];
    };
    for (Eigen::Index k = 1; k < num_blocks; ++k) {
      const Eigen::Matrix2d factor = block(k).before * block(k - 1).own.inverse();
      block(k).own -= factor * block(k - 1).after;
      right_.middleRows<2>(2 * k) -= factor * right_.middleRows<2>(2 * k - 2);
    }
    for (Eigen::Index k = num_blocks - 1; k >= 0; --k) {
      auto own = right_.middleRows<2>(2 * k);
      if (k + 1 < num_blocks) own -= block(k).after * right_.middleRows<2>(2 * k + 2);
      own = (block(k).own.inverse() * own).eval();
    }
    return std::move(right_);
  }

  [[nodiscard]] double scale() const { return scale_; }

 private:
  /// The equations at an inner point, by the unknowns of the points before, at and after it.
  struct Block {
    Eigen::Matrix2d before = Eigen::Matrix2d::Zero(), own = before, after = before;
  };

  /// What piece `i` says about jerk and snap at its beginning or at its end.
  void add_end(std::size_t i, bool at_end) {
    const Kind kind = kind_of(i, num_pieces_);
    const double ratio = (time_s_[i + 1] - time_s_[i]) / scale_;
    const bool mirrored = kind == Kind::last;
    const double x = at_end != mirrored ? 1 : 0;
    const std::size_t k = at_end ? i : i - 1;  // of the point's block
    Eigen::Matrix2d& of_begin = at_end ? blocks_[k].before : blocks_[k].own;
    Eigen::Matrix2d& of_end = at_end ? blocks_[k].own : blocks_[k].after;
    for (const int order : {3, 4}) {
      // The difference "from the left minus from the right" must vanish.
      const double sign = (at_end ? 1 : -1) * (mirrored && order == 3 ? -1 : 1);
      const double weight = sign / std::pow(ratio, order);
      const auto response = [&](double q0, double v0, double a0, double q1, double v1, double a1) {
        return weight * derivative(piece(kind, q0, v0 * ratio, a0 * ratio * ratio, q1, v1 * ratio,
                                         a1 * ratio * ratio),
                                   order, x);
      };
      of_begin.row(order - 3) +=
          Eigen::RowVector2d(response(0, 1, 0, 0, 0, 0), response(0, 0, 1, 0, 0, 0));
      of_end.row(order - 3) +=
          Eigen::RowVector2d(response(0, 0, 0, 0, 1, 0), response(0, 0, 0, 0, 0, 1));
      // A constant has no jerk, so only the difference of the positions counts.
      const auto column = static_cast<Eigen::Index>(i);
      right_.row(2 * static_cast<Eigen::Index>(k) + order - 3) -=
          response(0, 0, 0, 1, 0, 0) *
          (position_.col(column + 1) - position_.col(column)).transpose();
    }
  }

  const std::vector<double>& time_s_;
  const Eigen::MatrixXd& position_;
  std::size_t num_pieces_;
  double scale_;
  std::vector<Block> blocks_;
  Eigen::MatrixXd right_;
};

/// A column for each point.
Eigen::MatrixXd positions_of(const Waypoints& points) {
  if (const auto refused = points.refusal()) {
    throw std::invalid_argument(refused->key + ": " + refused->problem);
  }
  Eigen::MatrixXd position(points.position_rad.front().size(),
                           static_cast<Eigen::Index>(points.position_rad.size()));
  for (Eigen::Index i = 0; i < position.cols(); ++i) {
    position.col(i) = points.position_rad[static_cast<std::size_t>(i)];
  }
  return position;
}

}  // namespace

std::optional<schema::Refusal> Waypoints::refusal() const {
  if (time_s.size() < 2) {
    return {{"time_s", fmt::format("{} times; allowed: at least 2", time_s.size())}};
  }
  for (std::size_t i = 1; i < time_s.size(); ++i) {
    if (!(time_s[i - 1] < time_s[i])) {
      return {{"time_s",
               fmt::format(
                   "time {} ({} s) is not after time {} ({} s); allowed: strictly increasing times",
                   i + 1, time_s[i], i, time_s[i - 1])}};
    }
  }
  if (position_rad.size() != time_s.size()) {
    return {{"position_rad", fmt::format("{} positions; allowed: {}, one per time",
                                         position_rad.size(), time_s.size())}};
  }
  for (const robot::Vector& position : position_rad) {
    if (position.size() != position_rad.front().size()) {
      return {{"position_rad",
               fmt::format("a position with {} entries, the first has {}; allowed: one per joint",
                           position.size(), position_rad.front().size())}};
    }
  }
  return std::nullopt;
}

WaypointSpline::WaypointSpline(const Waypoints& points)
    : WaypointSpline(points.time_s, positions_of(points)) {}

WaypointSpline::WaypointSpline(std::vector<double> time_s, Eigen::MatrixXd position)
    : time_s_(std::move(time_s)), position_(std::move(position)) {
  Equations equations(time_s_, position_);
  inner_ = equations.solution();
  scale_ = equations.scale();
}

loop::ReferencePoint WaypointSpline::at(double t_s) const {
  const Eigen::Index num_joints = position_.rows();
  const robot::Vector zero = robot::Vector::Zero(num_joints);
  if (t_s <= time_s_.front()) return {position_.col(0), zero, zero, zero, zero};
  const Eigen::Index last = position_.cols() - 1;
  if (t_s >= time_s_.back()) return {position_.col(last), zero, zero, zero, zero};
  const auto after = std::upper_bound(time_s_.begin(), time_s_.end(), t_s);
  const Eigen::Index i = after - time_s_.begin() - 1;
  const Kind kind = kind_of(static_cast<std::size_t>(i), static_cast<std::size_t>(last));
  const bool mirrored = kind == Kind::last;
  const double begin = *(after - 1), end = *after, duration = end - begin;
  const double x = (mirrored ? end - t_s : t_s - begin) / duration;
  const double rate = (mirrored ? -1 : 1) / duration;
  const double ratio = duration / scale_;
  const auto unknown = [&](Eigen::Index point, int which, Eigen::Index joint) {
    return point == 0 || point == last ? 0.0 : inner_(2 * point - 2 + which, joint);
  };

  loop::ReferencePoint point{zero, zero, zero, zero, zero};
  for (Eigen::Index joint = 0; joint < num_joints; ++joint) {
    const Coefficients c =
        piece(kind, position_(joint, i), unknown(i, 0, joint) * ratio,
              unknown(i, 1, joint) * ratio * ratio, position_(joint, i + 1),
              unknown(i + 1, 0, joint) * ratio, unknown(i + 1, 1, joint) * ratio * ratio);
    // Horner's scheme for the polynomial and its first four derivatives divided by their
    // factorials.
    for (int k = degree(kind); k >= 0; --k) {
      point.snap_ref[joint] = point.snap_ref[joint] * x + point.jerk_ref[joint];
      point.jerk_ref[joint] = point.jerk_ref[joint] * x + point.a_ref[joint];
      point.a_ref[joint] = point.a_ref[joint] * x + point.v_ref[joint];
      point.v_ref[joint] = point.v_ref[joint] * x + point.q_ref[joint];
      point.q_ref[joint] = point.q_ref[joint] * x + c[static_cast<std::size_t>(k)];
    }
  }
  point.v_ref *= rate;
  point.a_ref *= 2 * rate * rate;
  point.jerk_ref *= 6 * rate * rate * rate;
  point.snap_ref *= 24 * rate * rate * rate * rate;
  return point;
}

}  // namespace tachless::reference::trajectory
