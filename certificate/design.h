#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "certificate/prediction.h"
#include "experiment/scenario.h"

/// Gains for a scenario's law, by the sampled loop. They start from a rule of thumb: with
/// m_j = 1 / (M^-1)_jj (what joint j feels when the others are free) and a bandwidth w,
///
///   kp = w^2 m_j,  kd = 2 w m_j,  a = b = r w,
///
/// which has two real poles at w for r → infinity. Other directions of motion than the joints' own
/// have the eigenvalues mu of M^-1 diag(m_j) in place of 1 and the damping sqrt(mu), whatever w: so
/// kd is also tried larger, and the m_j also chosen such that all mu are near each other. Of these
/// rules those count that settle first with the margins kept at all postures looked at, and of
/// those within a tenth of the first the one for which the matrix condition certifies the largest
/// region.
namespace tachless::certificate {

struct DesignGoal {
  std::optional<double> bandwidth_hz;  ///< w / 2 pi, at most
  std::optional<double> settling_s;    ///< to 1 % of an error in all joints
  double modulus = 0.5;                ///< least modulus margin
  double count_share = 0.01;           ///< of the torque limit, by one encoder count
};

struct Design {
  std::map<std::string, robot::Vector> gains;
  double w = 0;             ///< [rad/s]
  double damping = 0;       ///< kd / (2 w m_j)
  double filter_ratio = 0;  ///< a / w; 0 for a law without filter
  std::string binds;        ///< what keeps w from being larger
  Prediction loop;          ///< with these gains, as `certify` prints it
  /// The least modulus margin at postures spread over the range of the joints, beside those of the
  /// reference that `loop` is about.
  double modulus_in_range = 0;
  int postures_in_range = 0;
  /// Errors at rest that the matrix condition certifies, one joint at a time [rad; m]; empty where
  /// it certifies none, or all of them, as at a constant reference.
  robot::Vector certified_error;
  std::optional<double> missed;  ///< the settling time asked for, when it is not reached [s]
};

/// Postures: those of the reference and some spread over the range of the joints.
/// @throw diagnostics::Failure(check_said_no) when no gains do, naming why: a torque limit below
/// gravity, a motion that is too fast, margins that no bandwidth has.
Design design(const experiment::Scenario& scenario, const DesignGoal& goal,
              const OnProgress& tell = no_progress);

/// The gains as overrides of a scenario: "controller.gains.kp=[…]".
std::vector<std::string> overrides_of(const Design& design);

/// The scenario under another law, as overrides: its name, and gains by its rule of thumb alone,
/// two real poles at `hz` for each joint with its mean inertia, filters and observers
/// `filter_ratio` times as fast (at most 1 / h). Looks at no margin; for comparisons of laws.
/// @throw diagnostics::Failure(check_said_no) for a law without a rule, (bad_usage) for one that
/// the scenario's robot or reference does not suit
std::vector<std::string> rule_of_thumb(const experiment::Scenario& scenario, const std::string& law,
                                       double hz, double filter_ratio = 10);

}  // namespace tachless::certificate
