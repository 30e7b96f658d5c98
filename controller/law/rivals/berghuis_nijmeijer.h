#pragma once

#include <array>
#include <cmath>
#include <string_view>
#include <tuple>

#include "base/elementary.h"
#include "controller/law/parts.h"

namespace tachless::controller::law {

struct BerghuisNijmeijerGains {
  Vector lambda, kd;
  double observer_ld = 0;

  static constexpr std::tuple keys{
      gain("lambda", &BerghuisNijmeijerGains::lambda, "1/s",
           "Weight of the estimated position error, and of the observer's"),
      gain("kd", &BerghuisNijmeijerGains::kd, "N m s/rad",
           "Weight of the estimated velocity error"),
      gain("observer_ld", &BerghuisNijmeijerGains::observer_ld, "1/s", "Gain of the observer")};
};

/// Tracking of a rigid robot from link positions alone (`source`). Controller and observer together
/// are passive:
///
///   v_r = v_ref - Lambda (q_hat - q_ref),   v_0 = q_hatdot - Lambda (q - q_hat),
///   q_hatdot = z + (l_d + Lambda)(q - q_hat),   zdot = v_rdot + l_d Lambda (q - q_hat),
///   tau = M(q) v_rdot + C(q, v_0) v_r + g(q) - Kd (v_0 - v_r).
///
/// The observer's states are deviations from the reference (see Memory). The observer is linear in
/// them and exact for errors that are linear between samples. It uses no model. With
/// `feedforward_lead_s`, the first two terms use v_ref and vdot_ref at that time ahead; measured
/// and estimated values are not taken ahead.
class BerghuisNijmeijer : public RigidLaw<BerghuisNijmeijerGains> {
 public:
  static constexpr std::string_view name = "berghuis_nijmeijer";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"v_hat", "rad/s"}};
  static constexpr std::string_view source =
      "H. Berghuis and H. Nijmeijer, A passivity approach to controller-observer design for "
      "robots, IEEE Trans. Robotics and Automation 9(6), 1993, in the form implemented here";
  static constexpr std::string_view proved =
      "semiglobally exponentially stable, in continuous time";
  static constexpr std::string_view conditions =
      "observer_ld lambda_min(M) > lambda_max(Kd) and what the Coriolis terms of the initial "
      "errors and of sup |v_ref| add, which kd has to exceed as well";

  using Measurement = messages::PositionMeasurement;

  /// State of the observer. With e = q - q_ref and delta = q - q_hat, rho = z - v_ref - Lambda
  /// delta. While the error is constant, delta and rho stay zero if they are zero: q_hat = q and z
  /// = v_ref.
  struct Memory {
    Vector delta;       ///< [rad]
    Vector rho;         ///< [rad/s]
    Vector e_previous;  ///< [rad]

    static constexpr std::tuple members{&Memory::delta, &Memory::rho, &Memory::e_previous};
  };

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) {
    return {t.each(t.w / t.damping), t.damping * t.w * t.inertia, t.filter};
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Vector zero = Vector::Zero(measured.q.size());
    return {zero, zero, measured.q - reference.q_ref};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector& lambda = gains_.lambda;
    const Vector e = measured.q - reference.q_ref;
    const Memory next = observer_.step(memory, e);
    const Vector& delta = next.delta;
    const Vector v_hat_error =
        next.rho + gains_.observer_ld * delta + 2 * lambda.cwiseProduct(delta);  // q_hatdot - v_ref
    const Vector v_hat = reference.v_ref + v_hat_error;
    const Vector v_0 = v_hat - lambda.cwiseProduct(delta);
    const Vector e_hat = e - delta;  // q_hat - q_ref

    const auto [v_ref, a_ref] = ahead(reference);
    const Vector v_r = v_ref - lambda.cwiseProduct(e_hat);
    const Vector a_r = a_ref - lambda.cwiseProduct(v_hat_error);
    const Vector s = v_0 - reference.v_ref + lambda.cwiseProduct(e_hat);  // v_0 - v_r
    const Vector tau = robot::inverse_dynamics_bilinear(robot_, measured.q, v_0, v_r, a_r) -
                       gains_.kd.cwiseProduct(s);
    return {next, {tau}, {signals.size(), {e, v_hat}}};
  }

 private:
  /// The observer in (delta, rho),
  ///   deltadot = edot - rho - (l_d + 2 Lambda) delta,   rhodot = l_d Lambda delta - Lambda edot,
  /// solved exactly over a fixed time in which edot is constant: x' = Phi x + Gamma (e' - e).
  class Observer {
   public:
    Observer(const Gains& gains, double time_s)
        : phi_dd_(gains.lambda.size()),
          phi_dr_(phi_dd_),
          phi_rd_(phi_dd_),
          phi_rr_(phi_dd_),
          gamma_d_(phi_dd_),
          gamma_r_(phi_dd_) {
      for (Eigen::Index i = 0; i < gains.lambda.size(); ++i) {
        const double lambda = gains.lambda[i], ld = gains.observer_ld;
        const double a = ld + 2 * lambda, b = ld * lambda;
        // Both poles, the roots of s^2 + a s + b = 0, are real.
        const double root = std::sqrt(ld * ld + 4 * lambda * lambda);
        const double fast = -(a + root) / 2, slow = b / fast;
        // f(A) = (f(slow) (A - fast) - f(fast) (A - slow)) / (slow - fast), A = [-a -1; b 0].
        const double e_slow = base::exp(slow * time_s), e_fast = base::exp(fast * time_s);
        phi_dd_[i] = (e_slow * (-a - fast) - e_fast * (-a - slow)) / root;
        phi_dr_[i] = (e_fast - e_slow) / root;
        phi_rd_[i] = (e_slow - e_fast) * b / root;
        phi_rr_[i] = (e_fast * slow - e_slow * fast) / root;
        // Mean of e^(A t) over the time, applied to the input's (1, -Lambda).
        const double m_slow = base::expm1(slow * time_s) / (slow * time_s);
        const double m_fast = base::expm1(fast * time_s) / (fast * time_s);
        gamma_d_[i] = (m_slow * (-a - fast + lambda) - m_fast * (-a - slow + lambda)) / root;
        gamma_r_[i] = (m_slow * (b + lambda * fast) - m_fast * (b + lambda * slow)) / root;
      }
    }

    [[nodiscard]] Memory step(const Memory& memory, const Vector& e) const {
      const Vector rise = e - memory.e_previous;
      return {phi_dd_.cwiseProduct(memory.delta) + phi_dr_.cwiseProduct(memory.rho) +
                  gamma_d_.cwiseProduct(rise),
              phi_rd_.cwiseProduct(memory.delta) + phi_rr_.cwiseProduct(memory.rho) +
                  gamma_r_.cwiseProduct(rise),
              e};
    }

   private:
    Vector phi_dd_, phi_dr_, phi_rd_, phi_rr_, gamma_d_, gamma_r_;
  };

  /// The observer of one period.
  Observer observer_{gains_, settings_.period_s};
};

static_assert(OutputFeedbackLaw<BerghuisNijmeijer>);

}  // namespace tachless::controller::law
