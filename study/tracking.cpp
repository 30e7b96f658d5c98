#include "study/tracking.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tachless::study {
namespace {

constexpr std::int64_t fewest_ticks = 40;
// [rad; m] Below, no limit cycle is called so: encoders and noise swing too.
constexpr double small = 1e-3;
constexpr double large = 0.1;     // [rad; m] nor is a growing error below called divergence
constexpr double settled = 0.01;  // of the peak

/// Largest |y| from `from` to `to`.
double peak(const std::vector<Point>& points, double from, double to) {
  double result = 0;
  for (const Point& point : points) {
    if (point.x >= from && point.x <= to) result = std::max(result, std::abs(point.y));
  }
  return result;
}

/// How often the curve turns by more than `amplitude` from `from` on.
int turns(const std::vector<Point>& points, double from, double amplitude) {
  int count = 0;
  int direction = 0;
  double extreme = 0;
  bool first = true;
  for (const Point& point : points) {
    if (point.x < from) continue;
    if (first) extreme = point.y;
    first = false;
    const double change = point.y - extreme;
    if (change * direction > 0) extreme = point.y;
    if (std::abs(change) > amplitude && change * direction <= 0) {
      count += direction == 0 ? 0 : 1;
      direction = change > 0 ? 1 : -1;
      extreme = point.y;
    }
  }
  return count;
}

double amplitude_of(const std::vector<Point>& points) {
  if (points.empty()) return 0;
  const auto [low, high] = std::minmax_element(
      points.begin(), points.end(), [](const Point& a, const Point& b) { return a.y < b.y; });
  return high->y - low->y;
}

}  // namespace

void Extent::add(double value) {
  peak_ = std::max(peak_, std::abs(value));
  sum_of_squares_ += value * value;
  final_ = value;
  ++count_;
}

double Extent::rms() const {
  return count_ == 0 ? 0 : std::sqrt(sum_of_squares_ / static_cast<double>(count_));
}

Tracking::Tracking(int num_joints) : joints_(static_cast<std::size_t>(num_joints)) {}

void Tracking::add(double t_s, const robot::Vector& q, const robot::Vector& q_ref,
                   const robot::Vector& theta, const robot::Vector& tau) {
  const auto n = static_cast<Eigen::Index>(joints_.size());
  if (q.size() != n || q_ref.size() != n || tau.size() != n ||
      (theta.size() != n && theta.size() != 0)) {
    throw std::logic_error("Tracking::add: a vector's length is not the number of joints");
  }
  has_motors_ = theta.size() == n;
  ++num_ticks_;
  for (Eigen::Index i = 0; i < n; ++i) {
    JointTracking& joint = joints_[static_cast<std::size_t>(i)];
    const double error = q[i] - q_ref[i];
    joint.error.add(error);
    joint.torque.add(tau[i]);
    joint.q.add(t_s, q[i]);
    joint.q_ref.add(t_s, q_ref[i]);
    joint.abs_error.add(t_s, std::abs(error));
    joint.error_over_time.add(t_s, error);
    joint.tau.add(t_s, tau[i]);
    if (has_motors_) joint.theta.add(t_s, theta[i]);
  }
}

bool Observed::bad() const {
  return outcome == Outcome::saturated || outcome == Outcome::limit_cycle ||
         outcome == Outcome::diverging;
}

Observed observe(const Tracking& tracking, const std::vector<std::int64_t>& saturated_ticks) {
  Observed result;
  if (tracking.num_ticks() < fewest_ticks) return result;
  const auto ticks = static_cast<double>(tracking.num_ticks());
  std::size_t most_saturated = 0;
  for (std::size_t i = 0; i < saturated_ticks.size(); ++i) {
    const double share = static_cast<double>(saturated_ticks[i]) / ticks;
    if (share > result.saturated_share) most_saturated = i;
    result.saturated_share = std::max(result.saturated_share, share);
  }
  const auto decide = [&](Outcome outcome, std::size_t joint, double amplitude) {
    result.outcome = outcome;
    result.joint = joint;
    result.amplitude = amplitude;
  };
  bool all_converged = true;
  decide(Outcome::followed, 0, 0);
  for (std::size_t i = 0; i < tracking.joints().size(); ++i) {
    const std::vector<Point> error = tracking.joints()[i].error_over_time.points();
    const std::vector<Point> reference = tracking.joints()[i].q_ref.points();
    const double end = error.back().x, quarter = end / 4;
    const double first_half = peak(error, 0, 2 * quarter);
    const double third = peak(error, 2 * quarter, 3 * quarter);
    const double last = peak(error, 3 * quarter, end);
    if (last > large && last > 4 * first_half) {
      decide(Outcome::diverging, i, last);
      return result;
    }
    const int swings = turns(error, 3 * quarter, last);
    const int asked = turns(reference, 3 * quarter, 0.1 * amplitude_of(reference));
    const bool decays = last < 0.8 * third;
    if (last > small && !decays && swings >= 6 && swings > 3 * (asked + 1)) {
      decide(Outcome::limit_cycle, i, last);
      result.frequency_hz = swings / (2 * quarter);
      return result;
    }
    const double whole = std::max({first_half, third, last});
    double above_s = 0;
    for (const Point& point : error) {
      if (std::abs(point.y) > settled * whole) above_s = point.x;
    }
    all_converged = all_converged && (whole == 0 || above_s < 3 * quarter);
    result.settled_s = std::max(result.settled_s, above_s);
    if (last > result.amplitude) decide(Outcome::followed, i, last);
  }
  if (result.saturated_share > 0.5) {
    decide(Outcome::saturated, most_saturated, result.amplitude);
  } else if (all_converged) {
    result.outcome = Outcome::converged;
  }
  return result;
}

std::string text(const Observed& observed, const robot::JointLabels& joints) {
  const std::string joint = joints.joint(observed.joint);
  const std::string& unit = joints.length[observed.joint];
  switch (observed.outcome) {
    case Outcome::converged:
      return fmt::format("converged, settled within {:.3g} s", observed.settled_s);
    case Outcome::followed:
      return fmt::format("followed: error up to {:.2g} {} in the last quarter at {}",
                         observed.amplitude, unit, joint);
    case Outcome::saturated:
      return fmt::format("saturated: {} at its torque limit in {:.0f} % of ticks", joint,
                         100 * observed.saturated_share);
    case Outcome::limit_cycle:
      return fmt::format("limit cycle: {} swings by {:.2g} {} at {:.3g} Hz or more", joint,
                         observed.amplitude, unit, observed.frequency_hz);
    case Outcome::diverging:
      return fmt::format("diverging: the error of {} has grown to {:.2g} {}", joint,
                         observed.amplitude, unit);
    case Outcome::not_judged:
      break;
  }
  return "not judged: too few ticks";
}

}  // namespace tachless::study
