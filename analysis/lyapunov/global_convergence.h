#pragma once

#include <optional>
#include <string>

#include "scenario/scenario.h"

/// Global convergence: whether every initial state converges, in continuous time and with an exact
/// model.
namespace tachless::lyapunov {

/// Statement about global convergence.
struct GlobalConvergence {
  bool shown = false;  ///< every initial state converges; false: not shown
  std::string why;     ///< the reason, or the missing condition
  /// Least eigenvalue of D + sym C(q, v_ref) at sampled postures and instants [N m s/rad]; nothing
  /// where the reference comes to rest.
  std::optional<double> g0;
};

/// Returns the statement for a law with the paper's error equation and constant gains. Convergence
/// is shown where the reference comes to rest, and where fed-forward friction outweighs C(q,
/// v_ref). Returns nothing for other laws and for laws with an integral.
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
std::optional<GlobalConvergence> global_convergence(const scenario::Scenario& scenario);

}  // namespace tachless::lyapunov
