#pragma once

#include <string_view>

#include "controller/law/filtered_error.h"

namespace tachless::controller::law {

/// Regulation of a rigid robot from link positions alone, `source`:
///
///   tau = g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,   q_ref constant.
///
/// `LoriaOrtegaRigid` at a constant reference is this law. The reference is constant by assumption,
/// so a feed-forward lead changes nothing.
class KellyRegulation : public FilteredError<KellyRegulation> {
 public:
  static constexpr std::string_view name = "kelly_regulation";
  static constexpr std::string_view source =
      "R. Kelly, R. Ortega, A. Ailon and A. Loria, Global regulation of flexible joint robots "
      "using approximate differentiation, IEEE Trans. Automatic Control 39(6), 1994, for rigid "
      "joints";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions = "a constant reference; any positive gains";
  static constexpr bool regulation_only = true;

  using FilteredError::FilteredError;

  [[nodiscard]] Vector feedforward(const Vector& q, const ReferencePoint& /*reference*/) const {
    return robot::gravity_torque(robot_, q);
  }
};

static_assert(OutputFeedbackLaw<KellyRegulation>);

}  // namespace tachless::controller::law
