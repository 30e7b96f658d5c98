#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "commission/commission.h"
#include "robot/model.h"

/// Which signs, gravity and delay explain how an arm moved.
namespace tachless::commission {

/// Positions with joints turned about `offset` where `signs` is -1: another hypothesis' coordinates
/// from the scenario's, and back.
inline Vector turned(const Vector& q, const Vector& signs, const Vector& offset) {
  return offset + signs.cwiseProduct(q - offset);
}

/// The arm as the scenario has it, and what it may be instead: joints that turn against it.
class ArmHypotheses {
 public:
  /// @throw base::Failure(bad_usage) for flexible joints, and more than `most_joints`
  explicit ArmHypotheses(const scenario::Scenario& scenario);
  static constexpr int most_joints = 8;

  /// Signs +1 or -1, relative to the scenario's; of those, the ones whose start is within the
  /// joints' ranges.
  [[nodiscard]] const std::vector<Vector>& signs() const { return signs_; }
  /// M a + C v and g of that hypothesis, in the scenario's coordinates [N m; N].
  [[nodiscard]] Vector inertial(const Vector& signs, const Vector& q, const Vector& v,
                                const Vector& a) const;
  [[nodiscard]] Vector gravity(const Vector& signs, const Vector& q) const;
  /// Acceleration at the start [rad/s^2; m/s^2] under that torque; empty: none.
  [[nodiscard]] Vector fall(const Vector& signs, const Vector& tau = {}) const;
  /// 1 / (M^-1)_ii at the start, what a joint's motor feels when the others are free. The same for
  /// all signs where M is that of one posture.
  [[nodiscard]] const Vector& inertia() const { return inertia_; }
  [[nodiscard]] const Vector& start() const { return start_; }

 private:
  robot::Model model_;
  Vector offset_, start_, inertia_;
  std::vector<Vector> signs_;
};

/// The start of a motion without torque.
struct Fall {
  std::optional<bool> falls;     ///< nothing: it moved too little, or would have
  Vector signs;                  ///< that explain it best
  Vector certain;                ///< of `signs`, 0 where the other one explains it hardly less
  std::vector<Vector> possible;  ///< signs that explain it hardly less well
  double explained = 0;          ///< share of the motion
  bool moved = false;            ///< by more than a fifth of what gravity would
  Vector acceleration;           ///< measured [rad/s^2; m/s^2]
  int onset = 0;                 ///< tick from which on it is seen
};
Fall judge_fall(const ArmHypotheses& arm, const Trial& trial, double period_s);

/// Torque that acts per torque sent, from a like trial with gravity's torque in which `fall` goes
/// on until that acts; not a number for joints that gravity hardly pulls at. Negative: the torque
/// has another sign than the positions. @param arm with the signs that the fall has told
Vector scale_of_hold(const ArmHypotheses& arm, const Vector& falling, int onset, const Trial& trial,
                     double period_s);

inline constexpr int longest_delay = 6;  ///< [ticks] beyond the loop's own

/// The best explanation of trials of one joint after the other and one of all joints.
struct Explanation {
  struct Joint {
    double scale, viscous, dry, noise, delay;  ///< as in `Commissioned::Joint`
    double resolution;                         ///< of `dry` [N m; N]
    bool clean;                                ///< `noise` is small beside the torque that moves it
  };
  std::vector<Vector> signs;    ///< the best, and those that explain it hardly less well
  std::optional<bool> gravity;  ///< acts unaided; nothing: not determined
  int delay = 0;
  std::vector<Joint> joints;
  double cost = 0;  ///< twice the log-likelihood's loss
};
inline constexpr double clear = 12;  ///< least difference of costs that tells two apart
/// @param trials the last one of all joints; `sent` in the place of `tau` [N m; N]
/// @param certain signs that are known, 0: not
Explanation explain(const ArmHypotheses& arm, const std::vector<Trial>& trials, double period_s,
                    const Vector& certain, std::optional<bool> gravity);

}  // namespace tachless::commission
