#pragma once

#include <optional>
#include <string>
#include <vector>

#include "scenario/scenario.h"

/// Demands of a scenario's reference on its drives and joints, against their limits. The reference
/// alone makes these demands. Errors add to them.
namespace tachless::certify {

/// Speed of a joint's reference at the time when it is nearest to the limit there.
struct TightSpeed {
  double at_s = 0;
  double position = 0;  ///< [rad; m]
  double speed = 0;     ///< |v_ref| [rad/s; m/s]
  double limit = 0;     ///< plant::MotionGuard::speed_limit [rad/s; m/s]
};

struct JointDemand {
  std::string name;
  double at_rest = 0;  ///< largest |torque| that holds the arm at rest along the motion [N m; N]
  double moving = 0;   ///< largest |torque| along the motion [N m; N]
  double speed = 0;    ///< largest |v_ref| [rad/s; m/s]
  /// Frequency of the reference over the sampling rate: f h of its fastest sinusoid. Without a
  /// sinusoid it is sup|a_ref| / sup|v_ref| over 2 pi, times h.
  double cycles_per_tick = 0;
  std::optional<double> torque_limit{}, speed_limit{};  ///< nothing: none is given
  /// Given if the joint's speed limit decreases toward the ends of its range (robot::speed_limit).
  std::optional<TightSpeed> tight_speed{};
  /// The bound of a law that bounds its feed-forward, and the largest feed-forward over all
  /// postures [N m; N].
  std::optional<double> feedforward_max{}, feedforward_anywhere{};
  /// The bound holds for all postures and times; false: at sampled ones.
  bool feedforward_proved = false;
  std::string torque_unit = "N m", speed_unit = "rad/s";  ///< "N" and "m/s" of a prismatic joint
};

struct Feasibility {
  std::vector<JointDemand> joints;
  /// One line for each demand that the drives or joints cannot meet: joint, numbers, remedy.
  std::vector<std::string> impossible;
  /// One line for each setting that is possible and probably a mistake.
  std::vector<std::string> doubtful;
};

/// Returns the demands with the plant's own inertia, payload, friction and rotors, at
/// `reference::Motion::closely`.
/// @throw base::Failure(bad_usage) when reference or robot cannot be made of the scenario.
Feasibility feasibility(const scenario::Scenario& scenario);

}  // namespace tachless::certify
