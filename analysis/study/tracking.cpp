#include "study/tracking.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tachless::study {

// `a` comes before `b`.
Envelope::Bin Envelope::merge(const Bin& a, const Bin& b) {
  return {a.low.y <= b.low.y ? a.low : b.low, a.high.y >= b.high.y ? a.high : b.high};
}

// An odd one at the end stays as it is.
void Envelope::halve(std::vector<Bin>& bins) {
  for (std::size_t i = 0; i < bins.size() / 2; ++i) bins[i] = merge(bins[2 * i], bins[2 * i + 1]);
  if (bins.size() % 2 != 0) bins[bins.size() / 2] = bins.back();
  bins.resize((bins.size() + 1) / 2);
}

void Envelope::add(double x, double y) {
  const Bin sample{{x, y}, {x, y}};
  if (!bins_.empty() && samples_in_last_ < samples_per_bin_) {
    bins_.back() = merge(bins_.back(), sample);
    ++samples_in_last_;
    return;
  }
  if (bins_.size() == max_points / 2) {
    halve(bins_);
    samples_per_bin_ *= 2;
  }
  bins_.push_back(sample);
  samples_in_last_ = 1;
}

std::vector<Point> Envelope::points(std::size_t at_most) const {
  std::vector<Bin> bins = bins_;
  while (bins.size() > 1 && 2 * bins.size() > at_most) halve(bins);
  std::vector<Point> points;
  points.reserve(2 * bins.size());
  for (const auto& [low, high] : bins) {
    points.push_back(low.x <= high.x ? low : high);
    if (low.x != high.x) points.push_back(low.x <= high.x ? high : low);
  }
  return points;
}

void Extent::add(double value) {
  peak_ = std::max(peak_, std::abs(value));
  sum_of_squares_ += value * value;
  if (count_ == 0) first_ = value;
  final_ = value;
  ++count_;
}

double Extent::rms() const {
  return count_ == 0 ? 0 : std::sqrt(sum_of_squares_ / static_cast<double>(count_));
}

Tracking::Tracking(int num_joints) : joints_(static_cast<std::size_t>(num_joints)) {}

void Tracking::add(double t_s, const Vector& q, const Vector& q_ref, const Vector& theta,
                   const Vector& tau) {
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

}  // namespace tachless::study
