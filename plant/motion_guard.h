#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "base/quantities.h"
#include "robot/model.h"

/// Limits of a robot's motion, watched from positions alone. GuardedRobot and the guards of a loop
/// of one's own (analysis/own_loop) share them. Only the texts allocate memory.
namespace tachless::plant {

/// Returns "at tick 7", or "before the start" for a negative tick.
std::string when(std::int64_t tick);

/// Returns the limits of the following error where the scenario has none [rad; m].
inline Vector default_following_error(int num_joints) { return Vector::Constant(num_joints, 0.05); }

/// Mean speed of each joint over at least `window_s`, from positions. It never overestimates a
/// steady motion.
class SpeedMeter {
 public:
  static constexpr double window_s = 0.02;

  explicit SpeedMeter(Eigen::Index num_joints) : speed_(Vector::Zero(num_joints)) {}

  /// Takes positions that were read between two times of one clock [s].
  void add(const Vector& q, double begin_s, double end_s);
  [[nodiscard]] const Vector& speed() const { return speed_; }  ///< [rad/s; m/s]

 private:
  Vector speed_;
  Vector q_;  ///< positions at the beginning of the window; empty: no position yet
  double begin_s_ = 0;
};

/// Checks of the joints' ranges, speeds and following errors against their limits.
class MotionGuard {
 public:
  /// @param robot_file for messages
  /// @param following_error limit of each joint [rad; m]; empty: none
  /// @param speed_limit of each joint beside the URDF's [rad/s; m/s]; empty: none
  MotionGuard(robot::Model model, std::string robot_file, Vector following_error = {},
              Vector speed_limit = {})
      : model_(std::move(model)),
        robot_file_(std::move(robot_file)),
        following_error_(std::move(following_error)),
        speed_limit_(std::move(speed_limit)),
        first_error_(Vector::Zero(following_error_.size())) {
    if (speed_limit_.size() == 0)
      speed_limit_.setConstant(model_.num_joints, robot::Model::unlimited);
  }

  /// Returns true if `q` is outside the range of the URDF by more than rounding.
  [[nodiscard]] bool is_outside(Eigen::Index joint, double q) const;
  /// Returns true if a joint's speed limit decreases toward the ends of its range.
  [[nodiscard]] bool slows_near_ends(Eigen::Index joint) const;
  /// Time before which a joint is stopped that would be too fast for the end of its range. An arm
  /// that watches this limit itself stops at once.
  static constexpr double lead_s = SpeedMeter::window_s;
  /// Returns the limit of a joint's speed: the least of the one given and of the URDF's
  /// (robot::speed_limit) at the position that the joint reaches at `v` within `lead_s`.
  [[nodiscard]] double speed_limit(Eigen::Index joint, double q, double v) const;
  /// Returns true if |v| is above `speed_limit` by more than rounding.
  [[nodiscard]] bool is_fast(Eigen::Index joint, double q, double v) const;
  /// Returns the first joint whose |q - q_ref| exceeds its limit plus the first error; -1: none.
  [[nodiscard]] Eigen::Index late_joint(const Vector& q, const Vector& q_ref) const;
  /// Takes the error that the robot starts with.
  void set_first_error(const Vector& q, const Vector& q_ref) {
    first_error_ = (q - q_ref).cwiseAbs();
  }
  [[nodiscard]] bool watches_following() const { return following_error_.size() > 0; }

  [[nodiscard]] std::string range_text(Eigen::Index joint, double q, std::int64_t tick) const;
  [[nodiscard]] std::string speed_text(Eigen::Index joint, double q, double v,
                                       std::int64_t tick) const;
  /// @param contact text about a contact that is known, with its separator
  [[nodiscard]] std::string following_text(Eigen::Index joint, double error, std::int64_t tick,
                                           std::string_view contact = {}) const;

 private:
  [[nodiscard]] std::string name(Eigen::Index joint) const;
  [[nodiscard]] const char* unit(Eigen::Index joint) const;

  robot::Model model_;
  std::string robot_file_;
  Vector following_error_;
  Vector speed_limit_;
  Vector first_error_;
};

}  // namespace tachless::plant
