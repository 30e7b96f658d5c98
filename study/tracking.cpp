#include "study/tracking.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tachless::study {
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

}  // namespace tachless::study
