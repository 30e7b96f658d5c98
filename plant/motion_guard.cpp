#include "plant/motion_guard.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tachless::plant {
namespace {

/// Returns true if x is above `most` by more than rounding.
bool above(double x, double most) { return x > most + 1e-9 * std::max(1.0, std::abs(most)); }

}  // namespace

std::string when(std::int64_t tick) {
  return tick < 0 ? "before the start" : fmt::format("at tick {}", tick);
}

void SpeedMeter::add(const Vector& q, double begin_s, double end_s) {
  const double passed_s = end_s - begin_s_;
  if (q_.size() != 0) {
    if (passed_s >= 0 && passed_s < window_s) return;
    if (passed_s > 0) speed_ = (q - q_) / passed_s;  // else the times are those of another clock
  }
  q_ = q;
  begin_s_ = begin_s;
}

bool MotionGuard::is_outside(Eigen::Index joint, double q) const {
  return above(q, model_.upper[joint]) || above(-q, -model_.lower[joint]);
}

bool MotionGuard::slows_near_ends(Eigen::Index joint) const {
  return model_.deceleration_limit.size() > 0 && std::isfinite(model_.deceleration_limit[joint]);
}

double MotionGuard::speed_limit(Eigen::Index joint, double q, double v) const {
  return std::min(speed_limit_[joint], robot::speed_limit(model_, joint, q + lead_s * v, v));
}

bool MotionGuard::is_fast(Eigen::Index joint, double q, double v) const {
  return above(std::abs(v), speed_limit(joint, q, v));
}

Eigen::Index MotionGuard::late_joint(const Vector& q, const Vector& q_ref) const {
  for (Eigen::Index i = 0; i < following_error_.size(); ++i) {
    if (std::abs(q[i] - q_ref[i]) > first_error_[i] + following_error_[i]) return i;
  }
  return -1;
}

std::string MotionGuard::range_text(Eigen::Index joint, double q, std::int64_t tick) const {
  return fmt::format("{} is at {:.6g} {} {}, outside of its range {:.6g} to {:.6g} {} in {}",
                     name(joint), q, unit(joint), when(tick), model_.lower[joint],
                     model_.upper[joint], unit(joint), robot_file_);
}

std::string MotionGuard::speed_text(Eigen::Index joint, double q, double v,
                                    std::int64_t tick) const {
  const double limit = speed_limit(joint, q, v);
  const bool own = limit == speed_limit_[joint];
  const std::string place =
      !own && limit < model_.velocity_limit[joint]
          ? fmt::format(" at {:.6g} {}, near the end of its range,", q, unit(joint))
          : "";
  return fmt::format("{} moves at {:.6g} {}/s {}, faster than its limit{} of {:.6g} {}/s in {}",
                     name(joint), v, unit(joint), when(tick), place, limit, unit(joint),
                     own ? "plant.speed_limit_rad_per_s" : robot_file_);
}

std::string MotionGuard::following_text(Eigen::Index joint, double error, std::int64_t tick,
                                        std::string_view contact) const {
  return fmt::format(
      "{} is {:.4g} {} from its reference at tick {}, at the start it was {:.4g} {} "
      "(plant.following_error_rad: {:.4g}){}; first see whether the arm touches something, then "
      "joint_signs and whether the arm adds gravity itself (robot.compensates); soft gains with "
      "friction need more",
      name(joint), error, unit(joint), tick, first_error_[joint], unit(joint),
      following_error_[joint], contact);
}

std::string MotionGuard::name(Eigen::Index joint) const {
  return robot::joint_labels(model_).joint(static_cast<std::size_t>(joint));
}

const char* MotionGuard::unit(Eigen::Index joint) const {
  const robot::JointType type = model_.joint_types[static_cast<std::size_t>(joint)];
  return type == robot::JointType::prismatic ? "m" : "rad";
}

}  // namespace tachless::plant
