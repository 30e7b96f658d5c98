#pragma once

#include <array>
#include <string_view>

#include "controller/law/rivals/numerical_difference.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// `LoriaOrtegaRigid` with a difference of the error instead of its filter:
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd nu,   nu = (e_k - e_{k-m}) / (m h).
///
/// It is `NumericalDifference` with v_ref differenced like the position. On the trajectory the lag
/// of the two differences cancels. Before the first tick the error counts as e(0), so nu(0) = 0.
class DifferenceOfError : public RigidLaw<PositionDifference::Gains> {
 public:
  static constexpr std::string_view name = "difference_of_error";
  static constexpr std::string_view source =
      "common practice: the law of A. Loria and R. Ortega, Appl. Math. and Comp. Sci. 5(2), 1995, "
      "eq. 4, with a difference of the position error for its filtered derivative";
  static constexpr std::string_view proved = "nothing of the sampled loop; wen_bayard as m h -> 0";
  static constexpr std::string_view conditions =
      "those of wen_bayard, and m h short beside the loop";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"}};

  using Measurement = messages::PositionMeasurement;
  using Memory = PositionDifference::Memory;
  using RigidLaw<PositionDifference::Gains>::RigidLaw;

  static Gains tuned(const Tuning& tuning) { return PositionDifference::tuned(tuning); }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    ReferencePoint still = reference;
    still.v_ref.setZero();
    return difference_.start(measured.q - reference.q_ref, still);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    const Memory next = difference_.step(memory, e);
    const Vector nu = difference_.velocity(next);
    const auto [v_ref, a_ref] = ahead(reference);
    const Vector tau = robot::inverse_dynamics(robot_, measured.q, v_ref, a_ref) -
                       gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(nu);
    return {next, {tau}, {signals.size(), {e, nu}}};
  }

 private:
  PositionDifference difference_{gains_, settings_};
};

static_assert(OutputFeedbackLaw<DifferenceOfError>);

}  // namespace tachless::controller::law
