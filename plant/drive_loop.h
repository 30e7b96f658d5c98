#pragma once

#include <cstddef>
#include <memory>
#include <numbers>
#include <vector>

#include "base/quantities.h"
#include "plant/arm_state.h"
#include "plant/robot_driver.h"
#include "scenario/drive_loop.h"

namespace tachless::plant {

/// Set point that the host sends to the drives of `plant.drive.loop` beside a torque.
struct SetPoint {
  Vector q;  ///< q_des [rad; m]
  Vector v;  ///< v_des [rad/s; m/s]
};

/// A robot whose drives close a loop of their own (`plant.drive.loop`): the driver sends them set
/// points and that loop's gains beside the torque.
class DriveLoopDriver : public RobotDriver {
 public:
  /// Replaces `hold` in a scenario with `plant.drive.loop`. The drives take
  /// kp (q_des - q) + kd (v_des - v) + tau from now on.
  /// @param tau as for `hold`
  /// @param set_point in the driver's signs, for the middle of the time over which it is held
  virtual void follow(const Vector& tau, const SetPoint& set_point, double until_s) = 0;
};

/// Factors of a drive's velocity: v <- forget v + rate (q - q before).
struct VelocityFilter {
  double forget = 0;  ///< factor of the velocity before
  double rate = 0;    ///< factor of the change of the position [1/s]
};
/// Returns the factors of the velocity in `loop`.
inline VelocityFilter velocity_filter(const scenario::DriveLoopSpec& loop) {
  if (!loop.velocity_filter_hz) return {0, 1 / loop.period_s};
  const double cutoff = 2 * std::numbers::pi * *loop.velocity_filter_hz;
  const double both = 1 + cutoff * loop.period_s;
  return {1 / both, cutoff / both};
}

/// The loop inside the drives around an emulated robot. At each of its ticks a drive reads its
/// position, derives a velocity, and computes a torque, which acts `delay_ticks` later. The drives'
/// torque limits apply to the sum of all torques.
class EmulatedDriveLoop final : public DriveLoopDriver {
 public:
  /// @param count width of one count of the drives' own encoders (scenario::drive_count)
  /// @param limit of each drive's torque [N m; N]; empty: none
  EmulatedDriveLoop(std::unique_ptr<RobotDriver> robot, scenario::DriveLoopSpec loop, Vector count,
                    Vector limit);

  [[nodiscard]] bool measures_velocity() const override { return robot_->measures_velocity(); }
  void start() override { robot_->start(); }
  ArmState read() override { return robot_->read(); }
  /// Holds the torque without the loop.
  void hold(const Vector& tau, double until_s) override;
  void follow(const Vector& tau, const SetPoint& set_point, double until_s) override;
  void stop() override { robot_->stop(); }
  void rest(double until_s) override;

 private:
  struct Command {
    Vector tau;
    SetPoint set_point;
  };

  /// Computes the torque of one tick of the drives [N m; N].
  Vector torque();
  /// Returns the torque that was computed `delay_ticks` before `tau`.
  Vector delayed(const Vector& tau);

  std::unique_ptr<RobotDriver> robot_;
  scenario::DriveLoopSpec loop_;
  Vector count_, limit_;
  VelocityFilter filter_;
  Command used_;  ///< command that the drives use
  Vector q_before_, v_;
  std::vector<Vector> under_way_;  ///< torques that the drives have computed, a ring
  std::size_t next_ = 0;
  double now_s_ = 0;
};

}  // namespace tachless::plant
