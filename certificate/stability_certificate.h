#pragma once

#include <optional>
#include <string>
#include <vector>

#include "certificate/norm_conditions.h"
#include "certificate/sampled_certificate.h"
#include "certificate/weights.h"

/// The Lyapunov certificate of a scenario under the laws of Loria and Ortega: continuous time, an
/// exact model, no saturation, quantisation, delay or feed-forward lead.
namespace tachless::certificate {

/// What a choice of weights says of the scenario's own initial state.
struct Initial {
  double V = 0;  ///< [J]
  bool certified = false;
};

/// Weights, what they certify, and the scenario's initial state in it.
struct Choice {
  Certified certified;
  Initial initial;
};

struct StabilityCertificate {
  ErrorSystem system;
  bool proved = false;  ///< of all postures; otherwise of the sampled ones
  double B_d = 0;       ///< sup |v_ref| [rad/s; m/s]
  bool held = false;    ///< the reference is constant: proved with both weights 0, by LaSalle
  PrintedConditions printed, printed_gamma_free;
  ScalarCondition::Result completed;
  std::optional<Choice> one_weight, fastest, largest;
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
                                                          const OnProgress& on_progress = {});

/// V [J] of the error state x at posture q.
double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const robot::Vector& q, const Eigen::VectorXd& x);

/// M of the error equation's links: with the rotors of rigid joints.
robot::Model error_model(const experiment::Scenario& scenario);

}  // namespace tachless::certificate
