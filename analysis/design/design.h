#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "certify/prediction.h"
#include "design/uncertainty.h"
#include "scenario/scenario.h"

/// Gains for a scenario's law, found with the sampled loop. With these gains an error of any single
/// joint settles as fast as possible. The loop keeps a modulus margin at the postures of the
/// reference and over the range of the joints (gain_search.h).
///
/// The search starts from a rule of thumb. Let m_j = 1 / (M^-1)_jj be the inertia of joint j when
/// the others are free. Let d_j be its viscous friction and w a bandwidth:
///
///   kp = w (w m_j + d_j),  kd = 2 w m_j,  a = b = r w.
///
/// Friction then makes no slow pole. For one joint and r → infinity
/// m s^2 + (2 w m + d) s + kp = (s + w)(m s + w m + d).
namespace tachless::design {

/// Shares of the modulus margin outside the motion. Each posture there has to keep `range_share`.
/// The search demands `asked_share` at the postures that it has found, because it finds only few of
/// the postures with the least margin.
constexpr double range_share = 0.9, asked_share = 0.93;

/// Goals of a design; nothing: no such goal.
struct DesignGoal {
  std::optional<double> bandwidth_hz;  ///< upper limit: kp at most the rule's kp for this bandwidth
  /// Time to 1 % of an error that is short enough [s]. The search then increases the margin.
  std::optional<double> settling_s;
  std::optional<Vector> least_kp;  ///< stiffness of each joint, its spring included [N m/rad]
  std::optional<double> count_Nm;  ///< largest torque of one encoder count [N m]
  /// Initial error: kp times this error is within the torque limit [rad; m].
  std::optional<double> start_error;
  double modulus = 0.5;  ///< least modulus margin, along the motion
  /// Largest torque of one encoder count over the torque limit; nothing: 0.01.
  std::optional<double> count_share;
  std::optional<Uncertainty> uncertainty;  ///< set of plants for which the margin has to hold too
};

/// Result of a design.
struct Design {
  std::map<std::string, Vector> gains;
  std::vector<std::string> binds;  ///< constraints that bind the settling time, costliest first
  certify::Prediction loop;        ///< prediction with these gains, as `certify` prints it
  /// One line for each joint that stops beside its goal by more than a tenth of its motion. Such
  /// gains are unusable.
  std::vector<std::string> objections;
  /// One line for each joint that sticks beside its goal, each slow pole by friction, and each
  /// posture in range that lacks the margin.
  std::vector<std::string> warnings;
  /// Least modulus margin over the range of the joints, and its posture.
  double modulus_in_range = 0;
  double asked_in_range = 0;  ///< the modulus margin that the goal asks for there
  Vector range_q;
  /// Least modulus margin over the range with a plant of the uncertain set, and that plant.
  std::optional<double> uncertain_modulus;
  Vector uncertain_q;
  std::string uncertain_plant;
  std::optional<double> missed;  ///< the settling time asked for, if it is not reached [s]
};

/// Searches beside a design, whose gains are compared with its gains.
struct Beside {
  bool another_follows = false;  ///< the time left that `tell` gets includes a search for diagonal
                                 ///< gains
  /// Settling time of the gains found before [s]. A search whose gains settle much later is short:
  /// it keeps the margin, and does not look for the fastest start.
  double settling_s = infinity;
  /// Asked with the gains alone, before the long search of the joints' range. False ends the design
  /// with these gains alone, neither judged nor predicted. Empty: the design is always complete.
  std::function<bool(const Design&)> suits = {};
};

/// Designs the gains of a scenario's law. The result is deterministic.
/// @param answers answers of an external law. The search for its gains starts from the scenario's
/// gains, which have to make a stable loop. Each number changes by a factor of 100 at most. A gain
/// with equal numbers for all joints keeps them equal. The goals about kp, bandwidth and start
/// error do not apply.
/// @throw base::Failure(check_said_no) when no gains suffice. The message names the reason: a
/// torque limit below gravity, a motion that is too fast, or a margin that no gains keep
Design design(const scenario::Scenario& scenario, const DesignGoal& goal,
              const linear::OnProgress& tell = linear::no_progress,
              const linear::LawAnswers& answers = {}, const Beside& beside = {});

/// Returns the gains as overrides of a scenario: "controller.gains.kp=[…]". With `law`, the
/// overrides also name that law and drop the scenario's own gains.
std::vector<std::string> overrides_of(const Design& design, const std::string& law = "");

/// Computes gains by the rule of thumb of the scenario's law: two real poles at `hz` for each joint
/// with its mean inertia. Filters and observers are ten times as fast, at most 1 / h. No margin is
/// checked. The result serves for comparisons.
/// @throw base::Failure(check_said_no) for a law without a rule, (bad_usage) for a law that does
/// not suit the scenario's robot or reference
Design rule_of_thumb(const scenario::Scenario& scenario, double hz);

}  // namespace tachless::design
