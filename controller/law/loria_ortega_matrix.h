#pragma once

#include <string_view>
#include <tuple>

#include "controller/law/filtered_error.h"

namespace tachless::controller::law {

struct MatrixGains {
  Matrix kp, kd;
  double a = 0, b = 0;

  static constexpr std::tuple keys{
      base::Key{"kp", &MatrixGains::kp, "N m/rad", "Weight of the position errors"},
      base::Key{"kd", &MatrixGains::kd, "N m s/rad", "Weight of the filter outputs"},
      gain("a", &MatrixGains::a, "1/s", "Filter pole of all joints"),
      gain("b", &MatrixGains::b, "1/s", "Filter gain of all joints")};
};

/// `LoriaOrtegaRigid` with symmetric positive definite matrices Kp and Kd, and A = a I, B = b I.
/// Its proof only needs symmetric positive definite Kp, Kd B^-1 and Kd B^-1 A.
class LoriaOrtegaMatrix : public FilteredError<LoriaOrtegaMatrix, MatrixGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_matrix";
  static constexpr std::string_view source =
      "A. Loria and R. Ortega, On tracking control of rigid and flexible joint robots, Appl. Math. "
      "and Comp. Sci. 5(2), 1995, eq. 4-5 and Prop. 1, with matrices for its diagonal gains";
  static constexpr std::string_view proved =
      "exponentially stable from a certified region, in continuous time";
  static constexpr std::string_view conditions =
      "Kp and Kd symmetric and positive definite, a and b common to all joints; the matrix "
      "condition holds";

  using FilteredError::FilteredError;

  static Gains tuned(const Tuning& t) {
    return {t.kp().asDiagonal(), t.kd().asDiagonal(), t.filter, t.filter};
  }

  [[nodiscard]] Vector feedback(const Vector& tau, const Vector& e, const Vector& nu,
                                const ReferencePoint& /*reference*/) const {
    return tau - gains_.kp.lazyProduct(e) - gains_.kd.lazyProduct(nu);
  }
};

static_assert(OutputFeedbackLaw<LoriaOrtegaMatrix>);

}  // namespace tachless::controller::law
