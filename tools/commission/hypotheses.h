#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "commission/trials.h"
#include "robot/model.h"

/// Hypotheses on joint signs, gravity compensation and delay, which explain an arm's motion.
namespace tachless::commission {

/// Returns positions with the joints turned about `offset` where `signs` is -1. This converts
/// between a hypothesis' coordinates and the scenario's, in both directions.
inline Vector turned(const Vector& q, const Vector& signs, const Vector& offset) {
  return offset + signs.cwiseProduct(q - offset);
}

/// The scenario's arm and its alternatives: arms with joints that turn the other way.
class ArmHypotheses {
 public:
  /// @throw base::Failure(bad_usage) for flexible joints, and more than `most_joints`
  explicit ArmHypotheses(const scenario::Scenario& scenario);
  static constexpr int most_joints = 8;

  /// Returns the possible signs, +1 or -1 for each joint, relative to the scenario's. Alternatives
  /// whose start is outside the joints' ranges are left out.
  [[nodiscard]] const std::vector<Vector>& signs() const { return signs_; }
  /// Return M a + C v and g under a hypothesis, in the scenario's coordinates [N m; N].
  [[nodiscard]] Vector inertial(const Vector& signs, const Vector& q, const Vector& v,
                                const Vector& a) const;
  [[nodiscard]] Vector gravity(const Vector& signs, const Vector& q) const;
  /// Returns the acceleration at the start under the torque `tau` [rad/s^2; m/s^2]; empty: no
  /// torque.
  [[nodiscard]] Vector fall(const Vector& signs, const Vector& tau = {}) const;
  /// Returns 1 / (M^-1)_ii at the start, the inertia of each joint when the others are free. It is
  /// computed at the scenario's start for all signs.
  [[nodiscard]] const Vector& inertia() const { return inertia_; }
  /// Returns the least `inertia` of each joint under all signs.
  [[nodiscard]] const Vector& least_inertia() const { return least_inertia_; }
  /// Returns a diagonal D <= M at the start under all signs, with these rotors more. A feedback
  /// D (w^2 e + 2 w edot) is then nowhere faster than one joint with the pole w.
  [[nodiscard]] Vector below_mass_matrix(const Vector& rotors) const;
  [[nodiscard]] const Vector& start() const { return start_; }

 private:
  robot::Model model_;
  Vector offset_, start_, inertia_, least_inertia_;

  [[nodiscard]] Eigen::MatrixXd inverse_mass(const Vector& signs, const Vector& rotors) const;
  std::vector<Vector> signs_;
};

/// The beginning of a motion without torque.
struct Fall {
  std::optional<bool> falls;  ///< nothing: the motion was too small to tell
  Vector signs;               ///< signs that explain the motion best
  Vector certain;  ///< entries of `signs`; 0 where the opposite explains the motion almost as well
  std::vector<Vector> possible;  ///< signs that explain the motion almost as well
  double explained = 0;          ///< explained share of the motion
  bool springs = false;          ///< t^4 explains the motion far better than t^2
  bool moved = false;            ///< moved more than a fifth of what gravity would cause
  Vector acceleration;           ///< measured [rad/s^2; m/s^2]
  int onset = 0;                 ///< tick from which the motion is seen
};
/// Judges the beginning of a motion without torque.
/// @param count of the encoders [rad; m]
Fall judge_fall(const ArmHypotheses& arm, const Trial& trial, const Vector& count, double period_s);

/// Returns the acting torque over the sent torque, from a trial with a share of gravity's torque.
/// In this trial the acceleration `falling` lasts until the torque acts. The result of a joint is
/// NaN if gravity hardly loads the joint, or if gravity does not explain the joint's motion. A
/// negative result means that torque and positions have opposite signs. A joint whose motion hardly
/// differs from the fall has the result NaN too.
/// @param arm with the signs that the fall determined
Vector scale_of_hold(const ArmHypotheses& arm, const Vector& falling, int onset, const Trial& trial,
                     double share, const Vector& count, double period_s);

/// The answer of a joint to its own torque: q = c_0 + c_1 t + c_2 t^2 + compliance tau + response
/// times the double integral of tau, which acts after a delay. The parabola is a drift. A joint
/// that a brake holds has compliance alone.
struct Answer {
  double moved = 0;      ///< whole motion [rad; m]
  double own = 0;        ///< largest motion that the response explains [rad; m]
  double response = 0;   ///< [1/(kg m^2); 1/kg]
  double explained = 0;  ///< share of the motion beyond the others that the response explains
  double fits = 0;       ///< share of the motion beyond the drift that is explained
  /// Share of the whole trial's motion that a mass with dry friction explains without drift or
  /// compliance, and its response.
  double slides = 0, sliding = 0;
  double spring_hz = 0;  ///< of a spring that explains the motion far better; 0: none does
  double work = 0;       ///< of the torque, over the sum of its magnitudes
};
/// @param ticks at the end of the trial that are looked at
/// @param count of the joint's encoder [rad; m]
Answer answer_of(const Trial& trial, Eigen::Index joint, Eigen::Index ticks, double count,
                 double period_s);

/// The best explanation of the trials of each joint in turn and of all joints.
struct Explanation {
  struct Joint {
    double scale, heavier, viscous, dry, noise, delay;  ///< as in `Commissioned::Joint`
    double resolution;                                  ///< standard deviation of `dry` [N m; N]
    bool clean;  ///< `noise` is small against the torque that moves the joint
  };
  std::vector<Vector> signs;  ///< the best signs, then those almost as good
  /// True if gravity acts without compensation by the arm; nothing: not determined.
  std::optional<bool> gravity;
  int delay = 0;
  std::vector<Joint> joints;
  double cost = 0;  ///< negative log-likelihood up to a constant
};
/// Least difference of costs between distinguishable explanations.
inline constexpr double clear = 12;
/// Explains the trials by hypotheses.
/// @param trials the last one moves all joints; `tau` holds the sent torques [N m; N]
/// @param answers joints that answer their torque; the others explain nothing
/// @param certain known signs; 0: unknown
Explanation explain(const ArmHypotheses& arm, const std::vector<Trial>& trials, double period_s,
                    const std::vector<bool>& answers, const Vector& certain,
                    std::optional<bool> gravity);

}  // namespace tachless::commission
