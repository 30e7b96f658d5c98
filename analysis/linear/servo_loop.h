#pragma once

#include <array>
#include <optional>
#include <string_view>
#include <vector>

#include "robot/model.h"

/// Stability of joints under position actuators, tau = kp (u - q) - kv v, by the size of a step.
/// The map of one step is exact for small motions about a posture. Gravity's stiffness, friction
/// and force limits are left out.
namespace tachless::linear {

/// Who computes the torque of the actuators, and how the motion of a step follows from it.
enum class ServoStep {
  euler,     ///< semi-implicit: kp and kv at the start of the step, joint damping at its end
  rk4,       ///< Runge-Kutta's method of order 4
  implicit,  ///< kv and joint damping at the end of the step
  held,      ///< a loop of one's own, which holds the torque for a step; the motion is exact
};
inline constexpr std::array all_servo_steps{ServoStep::euler, ServoStep::rk4, ServoStep::implicit,
                                            ServoStep::held};
constexpr std::array<std::string_view, 4> names(ServoStep /*type*/) {
  return {"Euler", "RK4", "implicit, implicitfast", "held by a loop of your own"};
}

/// Gains by coordinate of the model. A coordinate with both gains 0 has no such actuator and moves
/// freely.
struct ServoGains {
  Vector kp;                           ///< [N m/rad; N/m]
  Vector kv;                           ///< [N m s/rad; N s/m]
  bool implicit_joint_damping = true;  ///< in Euler's method
};

/// The joint and posture at which the loop is unstable first as the step grows.
struct ServoLimit {
  double step_s = 0;  ///< largest stable step; infinite: none was found up to `longest_servo_step`
  Vector posture;     ///< [rad; m]
  int joint = -1;     ///< coordinate that moves fastest in the mode that is unstable first
};
inline constexpr double longest_servo_step = 0.05;   ///< [s]
inline constexpr double shortest_servo_step = 1e-7;  ///< [s]; unstable here: at every step

/// The loops of position actuators at some hundred postures.
class ServoLoop {
 public:
  /// @param postures to which postures spread over the joints' ranges are added
  ServoLoop(robot::Model model, ServoGains gains, const std::vector<Vector>& postures);

  /// Returns the least limit of all postures.
  [[nodiscard]] ServoLimit limit(ServoStep kind) const;
  /// Returns whether the loop is stable at all postures.
  [[nodiscard]] bool is_stable(ServoStep kind, double step_s) const;
  /// Returns the least armature [kg m2; kg] of all joints with actuators with which the loop is
  /// stable at all postures. A joint that has more keeps its own. Nothing: none was found up to
  /// 100.
  [[nodiscard]] std::optional<double> least_armature(ServoStep kind, double step_s) const;
  /// Returns the largest factor from 1 down to 0.001 on all kv with which the loop is stable at all
  /// postures.
  [[nodiscard]] std::optional<double> largest_kv_factor(ServoStep kind, double step_s) const;
  /// Returns the largest distance from the command at which each joint carries gravity
  /// [rad; m]; infinite without kp.
  [[nodiscard]] Vector droop() const;

 private:
  struct Change {
    double armature = 0, kv_factor = 1;
  };
  struct Matrices;
  [[nodiscard]] Matrices matrices(std::size_t posture, const Change& change) const;
  [[nodiscard]] bool is_stable(ServoStep kind, double step_s, const Change& change) const;

  robot::Model model_;
  ServoGains gains_;
  std::vector<int> driven_;  ///< coordinates with actuators
  std::vector<Vector> postures_;
  std::vector<Matrix> M_;                   ///< inertia at each
  mutable std::vector<std::size_t> order_;  ///< in which postures are tried, critical ones first
};

}  // namespace tachless::linear
