#include "reference/trajectory/waypoints.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace tachless::reference::trajectory {
namespace {

/// Coefficients of one joint's polynomial over one piece, in x in [0, 1].
using Coefficients = std::array<double, 10>;

/// Returns the polynomial that is at rest through snap at x = 0, with position q0 there. It has the
/// given position, velocity and acceleration at x = 1.
Coefficients from_rest(double q0, double q1, double v1, double a1) {
  const double d = q1 - q0;
  const double c5 = 21 * d - 6 * v1 + a1 / 2;
  const double c6 = -35 * d + 11 * v1 - a1;
  const double c7 = 15 * d - 5 * v1 + a1 / 2;
  return {q0, 0, 0, 0, 0, c5, c6, c7};
}

/// Returns whether piece `i` is the last of several; that piece is a first piece in mirrored time.
bool is_mirrored(std::size_t i, std::size_t num_pieces) { return i > 0 && i + 1 == num_pieces; }

/// Returns piece `i`. `v` and `a` are scaled by T and T^2. The first piece is at rest at its start.
/// The last piece runs in mirrored time and is at rest at its end. A single piece is at rest at
/// both ends. The pieces between are quintic Hermite polynomials.
Coefficients piece(std::size_t i, std::size_t num_pieces, double q0, double v0, double a0,
                   double q1, double v1, double a1) {
  if (num_pieces == 1) {
    const double d = q1 - q0;
    return {q0, 0, 0, 0, 0, 126 * d, -420 * d, 540 * d, -315 * d, 70 * d};
  }
  if (i == 0) return from_rest(q0, q1, v1, a1);
  if (is_mirrored(i, num_pieces)) return from_rest(q1, q0, -v0, a0);
  const double d = q1 - q0 - v0 - a0 / 2;
  const double e = v1 - v0 - a0;
  const double f = a1 - a0;
  return {q0, v0, a0 / 2, 10 * d - 4 * e + f / 2, -15 * d + 7 * e - f, 6 * d - 3 * e + f / 2};
}

/// Returns the `order`-th derivative of sum c_k x^k with respect to x.
double derivative(const Coefficients& c, int order, double x) {
  double sum = 0;
  for (int k = static_cast<int>(c.size()) - 1; k >= order; --k) {
    double factor = 1;
    for (int j = 0; j < order; ++j) factor *= k - j;
    sum = sum * x + factor * c[k];
  }
  return sum;
}

/// Equations at an inner point in the unknowns of the points before, at and after it. Row 0 is for
/// the velocity and row 1 for the acceleration at the point. `right` has a column for each joint.
struct Block {
  Eigen::Matrix2d before = Eigen::Matrix2d::Zero(), own = before, after = before;
  Eigen::Matrix2Xd right;
};

/// Returns the linear equations for velocity and acceleration at the inner points: jerk and snap
/// are continuous there. The unknowns are scaled by `scale`, the mean duration, which makes them
/// similar in size. A piece is linear in its end values, so unit values give its coefficients.
std::vector<Block> equations(const std::vector<double>& time_s, const Eigen::MatrixXd& position,
                             double scale) {
  const std::size_t num_pieces = time_s.size() - 1;
  std::vector<Block> blocks(num_pieces - 1);
  for (Block& block : blocks) block.right = Eigen::Matrix2Xd::Zero(2, position.rows());
  // Adds to block `k` the contribution of piece `i` to jerk and snap at the piece's beginning or
  // end.
  const auto add_end = [&](std::size_t i, std::size_t k, bool at_end) {
    Block& block = blocks[k];
    const double ratio = (time_s[i + 1] - time_s[i]) / scale;
    const bool mirrored = is_mirrored(i, num_pieces);
    const double x = at_end != mirrored ? 1 : 0;
    Eigen::Matrix2d& of_begin = at_end ? block.before : block.own;
    Eigen::Matrix2d& of_end = at_end ? block.own : block.after;
    for (const int order : {3, 4}) {
      // The equation is: value from the left minus value from the right equals zero.
      const double sign = (at_end ? 1 : -1) * (mirrored && order == 3 ? -1 : 1);
      const double cubed = ratio * ratio * ratio;
      const double weight = sign / (order == 3 ? cubed : cubed * ratio);
      const auto response = [&](double q0, double v0, double a0, double q1, double v1, double a1) {
        return weight * derivative(piece(i, num_pieces, q0, v0 * ratio, a0 * ratio * ratio, q1,
                                         v1 * ratio, a1 * ratio * ratio),
                                   order, x);
      };
      of_begin.row(order - 3) +=
          Eigen::RowVector2d(response(0, 1, 0, 0, 0, 0), response(0, 0, 1, 0, 0, 0));
      of_end.row(order - 3) +=
          Eigen::RowVector2d(response(0, 0, 0, 0, 1, 0), response(0, 0, 0, 0, 0, 1));
      // A constant has no jerk, so only the difference of the positions matters.
      const auto column = static_cast<Eigen::Index>(i);
      block.right.row(order - 3) -= response(0, 0, 0, 1, 0, 0) *
                                    (position.col(column + 1) - position.col(column)).transpose();
    }
  };
  for (std::size_t i = 0; i < num_pieces; ++i) {
    if (i > 0) add_end(i, i - 1, false);
    if (i + 1 < num_pieces) add_end(i, i, true);
  }
  return blocks;
}

/// Returns velocity (row 2 k) and acceleration (row 2 k + 1) at point k + 1, one column per joint.
/// It eliminates block by block, because a block has only its own unknowns and its neighbours'.
Eigen::MatrixXd solution(std::vector<Block> blocks, Eigen::Index num_joints) {
  for (std::size_t k = 1; k < blocks.size(); ++k) {
    const Eigen::Matrix2d factor = blocks[k].before * blocks[k - 1].own.inverse();
    blocks[k].own -= factor * blocks[k - 1].after;
    blocks[k].right -= factor * blocks[k - 1].right;
  }
  Eigen::MatrixXd all(2 * static_cast<Eigen::Index>(blocks.size()), num_joints);
  for (std::size_t k = blocks.size(); k-- > 0;) {
    const auto row = 2 * static_cast<Eigen::Index>(k);
    Eigen::Matrix2Xd right = blocks[k].right;
    if (k + 1 < blocks.size()) right -= blocks[k].after * all.middleRows<2>(row + 2);
    all.middleRows<2>(row) = blocks[k].own.inverse() * right;
  }
  return all;
}

/// Returns the positions with a column for each point.
/// @throw std::invalid_argument with `Waypoints::refusal`
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

std::optional<base::Refusal> Waypoints::refusal() const {
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
  for (const Vector& position : position_rad) {
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
    : time_s_(std::move(time_s)),
      position_(std::move(position)),
      scale_((time_s_.back() - time_s_.front()) / static_cast<double>(time_s_.size() - 1)),
      inner_(solution(equations(time_s_, position_, scale_), position_.rows())) {}

messages::ReferencePoint WaypointSpline::at(double t_s) const {
  const Eigen::Index num_joints = position_.rows();
  const Vector zero = Vector::Zero(num_joints);
  if (t_s <= time_s_.front()) return {position_.col(0), zero, zero, zero, zero};
  const Eigen::Index last = position_.cols() - 1;
  if (t_s >= time_s_.back()) return {position_.col(last), zero, zero, zero, zero};
  const auto after = std::upper_bound(time_s_.begin(), time_s_.end(), t_s);
  const Eigen::Index i = after - time_s_.begin() - 1;
  const auto index = static_cast<std::size_t>(i), num_pieces = static_cast<std::size_t>(last);
  const bool mirrored = is_mirrored(index, num_pieces);
  const double begin = *(after - 1), end = *after, duration = end - begin;
  const double x = (mirrored ? end - t_s : t_s - begin) / duration;
  const double rate = (mirrored ? -1 : 1) / duration;
  const double ratio = duration / scale_;
  const auto unknown = [&](Eigen::Index point, int which, Eigen::Index joint) {
    return point == 0 || point == last ? 0.0 : inner_(2 * point - 2 + which, joint);
  };

  messages::ReferencePoint point{zero, zero, zero, zero, zero};
  for (Eigen::Index joint = 0; joint < num_joints; ++joint) {
    const Coefficients c =
        piece(index, num_pieces, position_(joint, i), unknown(i, 0, joint) * ratio,
              unknown(i, 1, joint) * ratio * ratio, position_(joint, i + 1),
              unknown(i + 1, 0, joint) * ratio, unknown(i + 1, 1, joint) * ratio * ratio);
    // Horner's scheme for the polynomial and its first four derivatives, each divided by its
    // order's factorial.
    int degree = static_cast<int>(c.size()) - 1;
    while (degree > 0 && c[degree] == 0) --degree;
    for (int k = degree; k >= 0; --k) {
      point.snap_ref[joint] = point.snap_ref[joint] * x + point.jerk_ref[joint];
      point.jerk_ref[joint] = point.jerk_ref[joint] * x + point.a_ref[joint];
      point.a_ref[joint] = point.a_ref[joint] * x + point.v_ref[joint];
      point.v_ref[joint] = point.v_ref[joint] * x + point.q_ref[joint];
      point.q_ref[joint] = point.q_ref[joint] * x + c[k];
    }
  }
  point.v_ref *= rate;
  point.a_ref *= 2 * rate * rate;
  point.jerk_ref *= 6 * rate * rate * rate;
  point.snap_ref *= 24 * rate * rate * rate * rate;
  return point;
}

}  // namespace tachless::reference::trajectory
