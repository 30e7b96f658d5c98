#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "certify/prediction.h"
#include "scenario/scenario.h"

/// Gains for a scenario's law, by the sampled loop: those that settle first, judged by an error of
/// each joint alone, with a modulus margin kept at the postures of the reference and over the range
/// of the joints (gain_search.h). The search starts from a rule of thumb: with m_j = 1 / (M^-1)_jj
/// (what joint j feels when the others are free), viscous friction d_j and a bandwidth w,
///
///   kp = w (w m_j + d_j),  kd = 2 w m_j,  a = b = r w,
///
/// with which friction makes no slow pole: for one joint and r → infinity
/// m s^2 + (2 w m + d) s + kp = (s + w)(m s + w m + d).
namespace tachless::design {

/// Of the margin, what postures beside the motion have to keep, and what the search asks of those
/// that it knows: it finds few of those where the margin is least.
constexpr double range_share = 0.9, asked_share = 0.93;

struct DesignGoal {
  std::optional<double> bandwidth_hz;  ///< at most: kp no larger than the rule's for it
  std::optional<double> settling_s;    ///< to 1 % of an error; what is left over becomes margin
  std::optional<Vector> least_kp;      ///< stiffness, of each joint, its spring included [N m/rad]
  std::optional<double> count_Nm;      ///< largest torque of one encoder count
  std::optional<double> start_error;   ///< kp times that within the torque limit [rad; m]
  double modulus = 0.5;                ///< least modulus margin, along the motion
  std::optional<double> count_share;   ///< of the torque limit, by one encoder count; 0.01
};

struct Design {
  std::map<std::string, Vector> gains;
  std::vector<std::string> binds;  ///< what keeps it from being faster, the costliest first
  certify::Prediction loop;        ///< with these gains, as `certify` prints it
  /// A joint that sticks beside its goal, a slow pole by friction, a posture in range that lacks
  /// the margin. One line each.
  std::vector<std::string> warnings;
  /// The least modulus margin over the range of the joints, and where.
  double modulus_in_range = 0;
  Vector range_q;
  std::optional<double> missed;  ///< the settling time asked for, when it is not reached [s]
};

/// Deterministic. @throw base::Failure(check_said_no) when no gains do, naming why: a torque
/// limit below gravity, a motion that is too fast, margins that no gains have.
/// @param answers of an external law: its search starts from the scenario's gains, which have to
/// make a stable loop, changes each of their numbers (one for all joints stays one) by a factor of
/// 100 at most, and knows none of the goals about kp, bandwidth and start error
Design design(const scenario::Scenario& scenario, const DesignGoal& goal,
              const linear::OnProgress& tell = linear::no_progress,
              const linear::LawAnswers& answers = {});

/// The gains as overrides of a scenario: "controller.gains.kp=[…]"; of one under another law, with
/// that law's name and without the scenario's gains.
std::vector<std::string> overrides_of(const Design& design, const std::string& law = "");

/// A design of gains alone, by the rule of thumb of the scenario's law: two real poles at `hz` for
/// each joint with its mean inertia, filters and observers ten times as fast (at most 1 / h). Looks
/// at no margin; for comparisons.
/// @throw base::Failure(check_said_no) for a law without a rule, (bad_usage) for one that
/// the scenario's robot or reference does not suit
Design rule_of_thumb(const scenario::Scenario& scenario, double hz);

}  // namespace tachless::design
