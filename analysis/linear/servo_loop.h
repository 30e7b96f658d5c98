#pragma once

#include <array>
#include <optional>
#include <string_view>
#include <vector>

#include "robot/model.h"

/// Stability of joints under position actuators, tau = kp (u - q) - kv v, as a function of the step
/// size. The map of one step is exact for small motions about a posture. Gravity's stiffness,
/// friction and force limits are left out.
namespace tachless::linear {

/// Kind of step: the integrator, or a loop outside the simulator that computes the torque.
enum class ServoStep {
  euler,     ///< semi-implicit: kp and kv at the start of the step, joint damping at its end
  rk4,       ///< Runge-Kutta's method of order 4
  implicit,  ///< kv and joint damping at the end of the step
  held,      ///< a loop outside the simulator holds the torque for a step; the motion is exact
};
inline constexpr std::array all_servo_steps{ServoStep::euler, ServoStep::rk4, ServoStep::implicit,
                                            ServoStep::held};
constexpr std::array<std::string_view, 4> names(ServoStep /*type*/) {
  return {"Euler", "RK4", "implicit, implicitfast", "held by a loop of your own"};
}

/// Gains by coordinate of the model. A coordinate with both gains 0 has no position actuator and
/// moves freely.
struct ServoGains {
  Vector kp;                           ///< [N m/rad; N/m]
  Vector kv;                           ///< [N m s/rad; N s/m]
  bool implicit_joint_damping = true;  ///< Euler's method takes joint damping at the step's end
};

/// The joint and posture at which the loop is unstable first as the step grows.
struct ServoLimit {
  double step_s = 0;  ///< largest stable step; infinite: none was found up to `longest_servo_step`
  Vector posture;     ///< [rad; m]
  int joint = -1;     ///< coordinate that moves fastest in the mode that is unstable first
};
inline constexpr double longest_servo_step = 0.05;  ///< [s]
/// Shortest step that is tried [s]. A loop unstable at this step counts as unstable at every step.
inline constexpr double shortest_servo_step = 1e-7;

/// The loops of position actuators at some hundred postures.
class ServoLoop {
 public:
  /// @param postures checked besides postures spread over the joints' ranges
  ServoLoop(robot::Model model, ServoGains gains, const std::vector<Vector>& postures);

  /// Returns the least limit of all postures.
  [[nodiscard]] ServoLimit limit(ServoStep kind) const;
  /// Returns whether the loop is stable at all postures.
  [[nodiscard]] bool is_stable(ServoStep kind, double step_s) const;
  /// Returns the least armature [kg m2; kg] with which the loop is stable at all postures. Each
  /// joint with an actuator gets this armature, unless it has a larger one. Returns nothing if no
  /// armature up to 100 suffices.
  [[nodiscard]] std::optional<double> least_armature(ServoStep kind, double step_s) const;
  /// Returns the largest factor on all kv, at most 1, with which the loop is stable at all
  /// postures. Returns nothing if no factor down to 0.001 suffices.
  [[nodiscard]] std::optional<double> largest_kv_factor(ServoStep kind, double step_s) const;
  /// Returns each joint's largest steady deviation from the command under gravity, over all
  /// postures [rad; m]; infinite without kp.
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
  std::vector<Matrix> M_;                   ///< mass matrix at each posture
  mutable std::vector<std::size_t> order_;  ///< order of trying postures, critical ones first
};

}  // namespace tachless::linear
