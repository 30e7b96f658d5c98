#pragma once

#include <string_view>
#include <tuple>

#include "controller/law/filtered_error.h"

namespace tachless::controller::law {

struct ScheduledGains {
  double w = 0, damping = 0, a = 0, b = 0;

  static constexpr std::tuple keys{
      gain("w", &ScheduledGains::w, "rad/s", "Bandwidth of all joints"),
      gain("damping", &ScheduledGains::damping, "1", "Damping of their two poles"),
      gain("a", &ScheduledGains::a, "1/s", "Filter pole of all joints"),
      gain("b", &ScheduledGains::b, "1/s", "Filter gain of all joints")};
};

/// `LoriaOrtegaRigid` with gains that follow the reference:
///
///   Kp(t) = w^2 M(q_ref(t)) + w D,   Kd(t) = 2 damping w M(q_ref(t)),   A = a I, B = b I,
///
/// with D the viscous friction that is fed forward (`controller.friction`). Near the reference all
/// joints have the same error dynamics. The proof does not hold for gains with M at the measured q,
/// because Kp(q) e is no gradient.
class LoriaOrtegaScheduled : public FilteredError<LoriaOrtegaScheduled, ScheduledGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_scheduled";
  static constexpr std::string_view source =
      "derived here from A. Loria and R. Ortega, On tracking control of rigid and flexible joint "
      "robots, Appl. Math. and Comp. Sci. 5(2), 1995, eq. 4-5";
  static constexpr std::string_view proved =
      "exponentially stable from a certified region, in continuous time";
  static constexpr std::string_view conditions =
      "the matrix condition holds along the reference, with -1/2 Kp_dot and -1/2 Kd_dot / b in its "
      "first two blocks: a reference that is slow beside w";

  using FilteredError::FilteredError;

  static Gains tuned(const Tuning& t) { return {t.w, t.damping, t.filter, t.filter}; }

  [[nodiscard]] Vector feedback(const Vector& tau, const Vector& e, const Vector& nu,
                                const ReferencePoint& reference) const {
    return inertial_feedback(tau, e, nu, reference);
  }
  [[nodiscard]] Vector feedback_rate(const Vector& e, const Vector& nu,
                                     const ReferencePoint& reference) const {
    return inertial_feedback_rate(e, nu, reference);
  }
};

static_assert(OutputFeedbackLaw<LoriaOrtegaScheduled>);

}  // namespace tachless::controller::law
