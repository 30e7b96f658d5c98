#pragma once

#include <cmath>
#include <string_view>
#include <tuple>

#include "base/elementary.h"
#include "controller/law/rivals/estimated_velocity.h"

namespace tachless::controller::law {

/// Levant's second-order exact differentiator of each joint's position. With |d3q/dt3| <= L and
/// sigma = z0 - q,
///
///   z0dot = v0 = z1 - l2 L^(1/3) |sigma|^(2/3) sign(sigma),
///   z1dot = v1 = z2 - l1 L^(1/2) |z1 - v0|^(1/2) sign(z1 - v0),
///   z2dot = -l0 L sign(z2 - v1),
///
/// z1 = qdot and z2 = qddot hold exactly after a finite time, if q is free of noise. All three
/// signs equal the sign of sigma. The sampled form integrates the chain of integrators exactly from
/// sample to sample. It then adds the three corrections, with sigma at the new sample, times the
/// period.
class LevantDifferentiator {
 public:
  struct Memory {
    Vector z0, z1, z2;  ///< [rad], [rad/s], [rad/s^2]

    static constexpr std::string_view no_linearisation =
        "the differentiator corrects by the cube root of its error, which has no derivative at 0";
  };

  struct Gains {
    Vector kp, kd, lipschitz;

    static constexpr std::tuple keys{
        gain("kp", &Gains::kp, "N m/rad", "Weight of the position error"),
        gain("kd", &Gains::kd, "N m s/rad", "Weight of v_hat - v_ref"),
        gain("lipschitz", &Gains::lipschitz, "rad/s^3",
             "L: bound on the third derivative of the position")};
  };

  /// Computes gains with L the third derivative of an oscillation of 1 rad at the bandwidth.
  static Gains tuned(const Tuning& t) { return {t.kp(), t.kd(), t.each(t.w * t.w * t.w)}; }

  LevantDifferentiator(const Gains& gains, const Settings& settings)
      : lipschitz_(gains.lipschitz), period_s_(settings.period_s) {}

  [[nodiscard]] Memory start(const Vector& q, const ReferencePoint& reference) const {
    return moved({q, reference.v_ref, reference.a_ref}, -period_s_);
  }

  [[nodiscard]] Memory step(const Memory& memory, const Vector& q) const {
    Memory next = moved(memory, period_s_);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const double sigma = next.z0[i] - q[i];
      if (sigma == 0) continue;
      const double c0 = 2 * base::cbrt(lipschitz_[i] * sigma * sigma);  // |z1 - v0|
      const double c1 = 1.5 * std::sqrt(lipschitz_[i] * c0);            // |z2 - v1|
      const double towards_q = std::copysign(period_s_, -sigma);
      next.z0[i] += towards_q * c0;
      next.z1[i] += towards_q * c1;
      next.z2[i] += towards_q * 1.1 * lipschitz_[i];
    }
    return next;
  }

  [[nodiscard]] Vector velocity(const Memory& memory) const { return memory.z1; }

 private:
  /// Returns the memory after `time_s` without corrections.
  static Memory moved(const Memory& from, double time_s) {
    return {from.z0 + time_s * (from.z1 + time_s / 2 * from.z2), from.z1 + time_s * from.z2,
            from.z2};
  }

  Vector lipschitz_;
  double period_s_;
};

/// `EstimatedVelocity` by an exact differentiator (`source`) with the coefficients (l2, l1, l0) =
/// (2, 1.5, 1.1).
class RobustDifferentiator : public EstimatedVelocity<LevantDifferentiator> {
 public:
  static constexpr std::string_view name = "robust_differentiator";
  static constexpr std::string_view source =
      "A. Levant, Higher-order sliding modes, differentiation and output-feedback control, Int. J. "
      "of Control 76(9-10), 2003, as velocity source of the control law of Wen and Bayard (1988)";
  static constexpr std::string_view proved =
      "v_hat = v after a finite time, and wen_bayard from then on, in continuous time";
  static constexpr std::string_view conditions =
      "lipschitz >= sup |d3q/dt3| at each joint; those of wen_bayard";

  using EstimatedVelocity::EstimatedVelocity;
};

static_assert(OutputFeedbackLaw<RobustDifferentiator>);

}  // namespace tachless::controller::law
