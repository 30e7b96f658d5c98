#include "plant/drive_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tachless::plant {

EmulatedDriveLoop::EmulatedDriveLoop(std::unique_ptr<RobotDriver> robot,
                                     scenario::DriveLoopSpec loop, Vector count, Vector limit)
    : robot_(std::move(robot)),
      loop_(std::move(loop)),
      count_(std::move(count)),
      limit_(std::move(limit)),
      filter_(velocity_filter(loop_)) {}

void EmulatedDriveLoop::hold(const Vector& tau, double until_s) {
  robot_->hold(tau, until_s);
  now_s_ = until_s;
}

void EmulatedDriveLoop::rest(double until_s) {
  robot_->rest(until_s);
  now_s_ = until_s;
}

void EmulatedDriveLoop::follow(const Vector& tau, const SetPoint& set_point, double until_s) {
  const double begin_s = now_s_;
  const auto ticks = std::max(1L, std::lround((until_s - begin_s) / loop_.period_s));
  if (used_.tau.size() == 0) used_ = {tau, set_point};
  for (long j = 0; j < ticks; ++j) {
    if (j == std::min<long>(loop_.late_ticks, ticks - 1)) used_ = {tau, set_point};
    const double share = static_cast<double>(j + 1) / static_cast<double>(ticks);
    hold(delayed(torque()), begin_s + share * (until_s - begin_s));
  }
}

Vector EmulatedDriveLoop::torque() {
  Vector q = robot_->read().q;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    if (count_[i] > 0) q[i] = count_[i] * std::round(q[i] / count_[i]);
  }
  if (q_before_.size() == 0) {
    q_before_ = q;
    v_ = Vector::Zero(q.size());
  }
  v_ = filter_.forget * v_ + filter_.rate * (q - q_before_);
  q_before_ = q;
  Vector tau = used_.tau + loop_.kp.cwiseProduct(used_.set_point.q - q) +
               loop_.kd.cwiseProduct(used_.set_point.v - v_);
  if (limit_.size() > 0) tau = tau.cwiseMin(limit_).cwiseMax(-limit_);
  return tau;
}

Vector EmulatedDriveLoop::delayed(const Vector& tau) {
  if (loop_.delay_ticks == 0) return tau;
  under_way_.resize(static_cast<std::size_t>(loop_.delay_ticks), tau);  // the first one fills it
  Vector oldest = std::exchange(under_way_[next_], tau);
  next_ = (next_ + 1) % under_way_.size();
  return oldest;
}

}  // namespace tachless::plant
