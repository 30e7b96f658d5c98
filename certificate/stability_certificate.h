#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "certificate/matrix_condition.h"
#include "certificate/norm_conditions.h"
#include "certificate/sampled_certificate.h"

/// The Lyapunov certificate of a scenario under the laws of Loria and Ortega: continuous time, an
/// exact model, no saturation, quantisation, delay or feed-forward lead.
namespace tachless::certificate {

struct StabilityCertificate {
  ErrorSystem system;
  bool proved = false;  ///< of all postures; otherwise of the sampled ones
  double B_d = 0;       ///< sup |v_ref| [rad/s; m/s]
  bool held = false;    ///< the reference is constant: proved with both weights 0, by LaSalle
  PrintedConditions printed, printed_gamma_free;
  ScalarCondition::Result completed;
  std::optional<Certified> one_weight, fastest, largest;  ///< with V0 of the initial state
  std::vector<TradeOff> trade_off;
  Eigen::VectorXd initial;  ///< (e, nu, edot) at t = 0
  /// Why the certificate is not of this very scenario: payload, friction, a prismatic joint's
  /// range.
  std::vector<std::string> provisos;
};

/// Nothing, with the reason in `why_not`, for other laws and where a rigid law drives flexible
/// joints. @throw diagnostics::Failure(bad_usage)
std::optional<StabilityCertificate> stability_certificate(const experiment::Scenario& scenario,
                                                          const RobotConstants& constants,
                                                          std::string& why_not,
                                                          const OnProgress& tell = in_silence);

/// What is certified of V along the scenario's own run.
struct CertifiedRun {
  Weights weights;
  double V0 = 0;     ///< at the start [J]
  double level = 0;  ///< V <= level is invariant [J]; infinite at a constant reference
  double rate = 0;   ///< V <= V0 exp(-rate t) [1/s]; negative: the start is in no certified region
  bool proved = false;  ///< of all postures; otherwise of the sampled ones
  std::vector<std::string> provisos;

  /// Of V after t_s [J], in continuous time; infinite where nothing is certified.
  [[nodiscard]] double bound(double t_s) const {
    return rate < 0 ? infinity : V0 * std::exp(-rate * t_s);
  }
};

inline constexpr int most_joints_of_certified_run = 16;

/// With those weights, of the fastest rate and (two joints) of the largest ball, that certify the
/// faster decay from the scenario's start; without cross terms at a constant reference, where V
/// does not rise. Nothing as above, where no weights are certified at all, and with more joints
/// than `most_joints_of_certified_run`: 7 take 1 s, 14 take 6 s and 28 a minute.
std::optional<CertifiedRun> certified_run(const experiment::Scenario& scenario);

/// What the matrix condition certifies with the one weight of the largest ball, to compare gains
/// by: over few postures, unrefined. Nothing where `stability_certificate` has nothing, at a
/// constant reference, where the region has no limit, and when no weight is certified.
std::optional<Region> region_to_compare(const experiment::Scenario& scenario);

/// V [J] of the error state x at posture q.
double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const robot::Vector& q, const Eigen::VectorXd& x);

/// M of the error equation's links: with the rotors of rigid joints.
robot::Model error_model(const experiment::Scenario& scenario);

}  // namespace tachless::certificate
