#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "linear/effort.h"
#include "lyapunov/matrix_condition.h"
#include "lyapunov/norm_conditions.h"
#include "scenario/scenario.h"

/// The Lyapunov certificate of a scenario under the laws of Loria and Ortega: continuous time, an
/// exact model, no saturation, quantisation, delay or feed-forward lead.
namespace tachless::lyapunov {

/// The certificate of the scenario's own start. `certify`, the closing table of `run` and
/// summary.json all show this answer. It uses the weights that quick effort finds. Among the
/// weights whose region contains the start, it uses the weights with the least torque. At a
/// constant reference V has no cross terms. It uses the weights of full effort only if no region of
/// quick effort contains the start.
struct CertifiedStart {
  bool decided = false;  ///< false is possible for quick effort with sampled postures
  bool certified = false;
  bool proved = false;  ///< proved for all postures; otherwise for the sampled postures
  /// The largest share of a torque limit from the start on. Nothing: not certified, flexible
  /// joints, or no limits.
  std::optional<double> torque_share;
};

/// The region that one choice of the weights certifies, and its bounds from the scenario's start.
struct CertifiedRegion : Certified {
  double rate = 0;  ///< of V in the limit of small errors, mu [1/s]; the error decays at mu/2
  double V0 = 0;    ///< V at the start [J]
  /// V <= V0 exp(-rate t) from the start on [1/s]; negative: the start is outside the region.
  double rate_from_start = -1;

  /// Largest constant disturbance torque for which the region contains the scenario's start, for a
  /// law with an integral [N m]. The torque acts at one joint alone. Empty: the law has no
  /// integral.
  Eigen::VectorXd unknown_torque;
  /// The largest share of the level that the integral's part of V takes, for unknown torques up to
  /// `d_max` of each joint. Nothing: the law has no integral, or d_max has no bound.
  std::optional<double> integral_share;
  /// Final bound of |e_i| for motions from V <= level / 4, with the friction that is not in Mm
  /// [rad; m]. Nothing: there is no such friction. Empty: no bound is certified.
  std::optional<Eigen::VectorXd> friction_error;

  /// The largest V of the region up to which no torque reaches its limit [J], for a rigid robot
  /// with torque limits. `joint` is the joint whose torque reaches its limit first. `share` is the
  /// largest share of a limit from the start on, if the region contains the start. The torque is at
  /// most |feed-forward| + |Kp e + Kd nu|. The feed-forward is evaluated at sampled instants and
  /// errors.
  struct Torque {
    double level = 0;
    Eigen::VectorXd e_at_rest;  ///< largest error of one joint alone, within that level [rad; m]
    Eigen::Index joint = 0;
    std::optional<double> share;
  };
  std::optional<Torque> torque;

  /// The postures for which the region is certified: each joint within `tube` of q_ref(t) [rad; m].
  /// An entry of pi means all postures of that joint. Empty: every posture. No error leaves the
  /// tube while V <= level, so the tube is part of the region.
  Eigen::VectorXd tube;
  bool starts_in_tube = true;
  /// Largest quotient of an error and its entry of `tube`, before the tube reduces the level.
  double beyond_tube = 0;

  [[nodiscard]] bool holds_initial_state() const { return V0 <= region.level && starts_in_tube; }
};

inline bool holds_start(const std::optional<CertifiedRegion>& region) {
  return region && region->holds_initial_state();
}
/// Adds the answer of one more region to `start`. Each region that holds the start bounds its
/// torque.
inline void add(CertifiedStart& start, const std::optional<CertifiedRegion>& region) {
  if (!holds_start(region)) return;
  start.decided = start.certified = true;
  if (!region->torque) return;
  start.torque_share = std::min(*region->torque->share, start.torque_share.value_or(infinity));
}

struct StabilityCertificate {
  bool proved = false;       ///< proved for all postures; otherwise for the sampled postures
  double B_d = 0;            ///< sup |v_ref| [rad/s; m/s]
  bool own_weights = false;  ///< the law's integral determines the weights, which are in `fastest`
  bool constant = false;     ///< the reference is constant: proved with both weights 0, by LaSalle
  /// Regions by the weights of the fastest rate and of the largest ball; nothing: no weights are
  /// certified. At a constant reference the ball has no limit, so there is no largest region.
  std::optional<CertifiedRegion> fastest, largest;
  CertifiedStart start;
  double V0 = 0;  ///< V at the start with both weights 0, at a constant reference [J]
  /// Reasons why the certificate does not describe this very scenario: payload, friction, drives.
  std::vector<std::string> provisos;
};

/// Returns the reasons why a region does not describe this very scenario.
/// @param disturbed whether friction of rigid joints disturbs
std::vector<std::string> provisos(const scenario::Scenario& scenario, bool disturbed);

inline constexpr int most_joints_of_certified_run = 16;

/// Returns the certificate of a scenario. With sampled postures the region covers every posture, or
/// only postures near the reference if that region is larger.
/// @param effort `quick` leaves out `largest` if postures are sampled (7 joints take 5 s). It
/// leaves out all regions for more joints than `most_joints_of_certified_run` (28 would take a
/// minute).
/// @param why_not receives the reason of `no_certificate` where nothing is returned
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
std::optional<StabilityCertificate> stability_certificate(
    const scenario::Scenario& scenario, linear::Effort effort, std::string& why_not,
    const linear::OnProgress& tell = linear::no_progress);

/// Returns the outline of the certified starts in the plane of two joints' initial positions: 72
/// points around q_ref(0). Everything else is as in the scenario. The outline belongs to the
/// region, or to the part that the torque limits allow. Empty: nothing is certified there, or
/// everything.
std::vector<Eigen::Vector2d> certified_outline(const scenario::Scenario& scenario, int i, int j);

/// The constants and conditions that the paper prints, for the scenario's loop. The function below
/// throws as `stability_certificate` does, and writes its reason to `why_not`.
struct PaperConditions {
  RobotConstants constants;
  PrintedConditions printed;
};
std::optional<PaperConditions> paper_conditions(const scenario::Scenario& scenario,
                                                std::string& why_not);

/// The bounds that are certified for V along the scenario's own run.
struct CertifiedRun {
  Weights weights;
  double V0 = 0;     ///< at the start [J]
  double level = 0;  ///< V <= level is invariant [J]; infinite at a constant reference
  double rate = 0;   ///< V <= V0 exp(-rate t) [1/s]; negative: the start is in no certified region
  bool proved = false;  ///< proved for all postures; otherwise for the sampled postures
  std::vector<std::string> provisos;
  CertifiedStart start;

  /// Returns the bound of V after t_s [J], in continuous time. It is infinite where nothing is
  /// certified.
  [[nodiscard]] double bound(double t_s) const {
    return rate < 0 ? infinity : V0 * std::exp(-rate * t_s);
  }
};

/// Returns the bounds by `stability_certificate` with quick effort. They use the weights that
/// certify the faster decay from the scenario's start. At a constant reference V has no cross terms
/// and does not rise. Returns nothing where no weights are certified.
std::optional<CertifiedRun> certified_run(const scenario::Scenario& scenario);

}  // namespace tachless::lyapunov
