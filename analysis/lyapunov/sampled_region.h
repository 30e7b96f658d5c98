#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "linear/effort.h"
#include "lyapunov/one_tick.h"

namespace tachless::lyapunov {

/// Region of attraction of the one-tick map F at a posture (one_tick.h). The region is the largest
/// set V <= 1, with V(x) = x' P x, in which a search found no x with V(F(x)) >= V(x). F runs the
/// law's own code. The region is searched, not proved.
struct SampledRegion {
  Vector q_ref;
  Eigen::MatrixXd P;
  /// `e_at_rest`: largest error of one joint alone at rest, with the law's start memory [rad; m].
  /// `edot`: largest rate of one joint alone [rad/s; m/s].
  Eigen::VectorXd e_at_rest, edot;
  double widest = 0;   ///< largest error of a joint in the set [rad; m]
  bool cut = false;    ///< the set ends where the search ends, without a violation
  int directions = 0;  ///< directions searched for the result, besides local ascents

  [[nodiscard]] double V(const Eigen::VectorXd& x) const { return x.dot(P * x); }
};

/// Returns the region about the start of the reference's motion. P is the best of several P = Q +
/// sum_k w_k A_k' P A_k / r², with A_k the one-tick maps linearised at postures about q_ref.
/// Returns nothing for a law that cannot be linearised, for dry friction, and if no set was found.
/// `why_not` receives the reason.
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
std::optional<SampledRegion> sampled_region(const scenario::Scenario& scenario,
                                            std::string& why_not,
                                            const linear::OnProgress& tell = linear::no_progress);

}  // namespace tachless::lyapunov
