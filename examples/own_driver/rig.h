#pragma once

#include <chrono>

#include <tachless/robot/model.h>

namespace tachless::own_driver {

/// Stand-in for a robot and its fieldbus library; replace it by your own. It is an arm on a bench
/// that moves in wall-clock time, with 20-bit encoders. The drives brake by themselves when no
/// torque has come for `watchdog`, also after the program has ended.
class Rig {
 public:
  static constexpr std::chrono::milliseconds watchdog{500};

  /// Starts at rest at q = 0 with closed brakes.
  explicit Rig(const robot::Model& model);

  [[nodiscard]] Vector read_encoders();  ///< [rad]
  void enable();                         ///< opens the brakes
  void write_torque(const Vector& tau);  ///< [N m], acts from now on
  void brake();                          ///< sets the torque to zero and closes the brakes
  /// Returns whether the drives have braked by themselves.
  [[nodiscard]] bool watchdog_has_tripped();

 private:
  using Clock = std::chrono::steady_clock;

  void move_on();

  robot::Model model_;
  Vector q_, v_, tau_;
  Clock::time_point now_;  ///< time of q_ and v_
  Clock::time_point written_;
  bool enabled_ = false;
  bool tripped_ = false;
};

}  // namespace tachless::own_driver
