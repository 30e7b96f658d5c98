#pragma once

#include <chrono>

#include <tachless/robot/model.h>

namespace tachless::own_driver {

/// Stands for what comes with a robot: the library of its fieldbus, and behind that the robot. An
/// arm on a bench that moves on the wall clock, with encoders of 20
/// bits, and with drives that brake by themselves when no torque has come for `watchdog`,
/// also when the program has ended. Replace it by yours.
class Rig {
 public:
  static constexpr std::chrono::milliseconds watchdog{500};

  /// Hangs still at q = 0, brakes closed.
  explicit Rig(const robot::Model& model);

  [[nodiscard]] Vector read_encoders();  ///< [rad]
  void enable();                         ///< opens the brakes
  void write_torque(const Vector& tau);  ///< [N m], from now on
  void brake();                          ///< no torque, brakes closed
  /// Whether the drives have braked by themselves.
  [[nodiscard]] bool watchdog_has_tripped();

 private:
  using Clock = std::chrono::steady_clock;

  void move_on();

  robot::Model model_;
  Vector q_, v_, tau_;
  Clock::time_point now_;  ///< of q_ and v_
  Clock::time_point written_;
  bool enabled_ = false;
  bool tripped_ = false;
};

}  // namespace tachless::own_driver
