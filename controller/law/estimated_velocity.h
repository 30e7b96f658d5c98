#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"

/// The law of Wen and Bayard with an estimate in the place of the measured velocity, and the two
/// estimators that know nothing of noise. The one that does is in kalman_velocity.h.
namespace tachless::controller::law {

/// Velocity from sampled positions. `start` gives the memory before the first sample is given to
/// `step`, which is then told the `ticks` >= 1 periods since the sample before; `velocity` is what
/// the memory says of the sample last given [rad/s]. The first one is v_ref.
template <class E>
concept VelocityEstimator = std::constructible_from<E, const typename E::Gains&, const Settings&> &&
    requires(const E& estimator, const typename E::Memory& memory, const Vector& q,
             const ReferencePoint& reference, int ticks) {
  { estimator.start(q, reference) } -> std::same_as<typename E::Memory>;
  { estimator.step(memory, q, ticks) } -> std::same_as<typename E::Memory>;
  { estimator.velocity(memory) } -> std::convertible_to<Vector>;
};

/// `WenBayard` with an estimate v_hat in the place of the measured velocity:
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd (v_hat - v_ref).
///
/// Base of the laws that differ by where v_hat comes from; no law by itself. With
/// `feedforward_lead_s`, v_ref and vdot_ref of the first two terms are taken that much ahead.
template <VelocityEstimator Estimator>
class EstimatedVelocity : public RigidLaw<typename Estimator::Gains> {
  using Base = RigidLaw<typename Estimator::Gains>;

 public:
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"v_hat", "rad/s"}};

  using Measurement = loop::PositionMeasurement;
  using Memory = typename Estimator::Memory;
  using Base::Base;

  static auto tuned(const Tuning& tuning) { return Estimator::tuned(tuning); }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return estimator_.start(measured.q, reference);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference, int ticks = 1) const {
    const Memory next = estimator_.step(memory, measured.q, ticks);
    const Vector e = measured.q - reference.q_ref;
    const Vector v_hat = estimator_.velocity(next);
    const auto [v_ref, a_ref] = this->ahead(reference);
    const Vector tau = robot::inverse_dynamics(this->robot_, measured.q, v_ref, a_ref) -
                       this->gains_.kp.cwiseProduct(e) -
                       this->gains_.kd.cwiseProduct(v_hat - reference.v_ref);
    return {next, {tau}, {signals.size(), {e, v_hat}}};
  }

 private:
  Estimator estimator_{this->gains_, this->settings_};
};

/// v_hat = (q_k - q_{k-m}) / (m h). A position whose tick was lost lies on the straight line
/// between those measured before and after it; those before the first one on a line of slope v_ref.
class PositionDifference {
 public:
  static constexpr int most_samples = 64;

  struct Memory {
    std::array<Vector, most_samples + 1> q;  ///< newest first; beyond m empty [rad]

    static constexpr std::tuple members{&Memory::q};
  };

  struct Gains {
    Vector kp, kd;
    int samples = 1;

    static constexpr std::tuple keys{
        gain("kp", &Gains::kp, "N m/rad", "Weight of the position error"),
        gain("kd", &Gains::kd, "N m s/rad", "Weight of v_hat - v_ref"),
        schema::Key{"samples", &Gains::samples, "ticks",
                    "m: over how many periods the difference is"}
            .in({1, most_samples})};
  };

  /// A difference over m periods lags by half of them, a filter by 1 / its pole.
  static Gains tuned(const Tuning& t) {
    const double samples = std::round(2 / (t.filter * t.period_s));
    return {t.kp(), t.kd(), static_cast<int>(std::clamp(samples, 1.0, most_samples * 1.0))};
  }

  PositionDifference(const Gains& gains, const Settings& settings)
      : m_(static_cast<std::size_t>(gains.samples)), period_s_(settings.period_s) {}

  [[nodiscard]] Memory start(const Vector& q, const ReferencePoint& reference) const {
    Memory memory;
    for (std::size_t j = 0; j <= m_; ++j) {
      memory.q[j] = q - static_cast<double>(j + 1) * period_s_ * reference.v_ref;
    }
    return memory;
  }

  [[nodiscard]] Memory step(const Memory& memory, const Vector& q, int ticks) const {
    Memory next;
    const auto gap = static_cast<std::size_t>(ticks);
    for (std::size_t j = 0; j <= m_; ++j) {
      next.q[j] = j < gap ? Vector(q + (memory.q[0] - q) * (static_cast<double>(j) / ticks))
                          : memory.q[j - gap];
    }
    return next;
  }

  [[nodiscard]] Vector velocity(const Memory& memory) const {
    return (memory.q[0] - memory.q[m_]) / (static_cast<double>(m_) * period_s_);
  }

 private:
  std::size_t m_;
  double period_s_;
};

/// `EstimatedVelocity` by a difference of positions: what most controllers without a tachometer do,
/// and what section 1 of Loria and Ortega (1995) argues against. With counts of width Delta,
/// |v_hat - v| <= Delta / (m h) + (m h / 2) sup |vdot|.
class NumericalDifference : public EstimatedVelocity<PositionDifference> {
 public:
  static constexpr std::string_view name = "numerical_difference";
  static constexpr std::string_view source =
      "common practice: the control law of J. T. Wen and D. S. Bayard, Int. J. of Control 47(5), "
      "1988, eq. 4.2, with a difference of positions for the velocity";
  static constexpr std::string_view proved = "nothing of the sampled loop; wen_bayard as m h -> 0";
  static constexpr std::string_view conditions =
      "those of wen_bayard, and m h short beside the loop; the error of v_hat is at most Delta / "
      "(m h) + (m h / 2) sup |vdot| with counts of width Delta, least at m h = sqrt(2 Delta / sup "
      "|vdot|)";

  using EstimatedVelocity::EstimatedVelocity;
};

static_assert(OutputFeedbackLaw<NumericalDifference>);

/// Levant's second-order exact differentiator of each joint's position: with |d3q/dt3| <= L and
/// sigma = z0 - q,
///
///   z0dot = v0 = z1 - l2 L^(1/3) |sigma|^(2/3) sign(sigma),
///   z1dot = v1 = z2 - l1 L^(1/2) |z1 - v0|^(1/2) sign(z1 - v0),
///   z2dot = -l0 L sign(z2 - v1),
///
/// after a finite time z1 = qdot and z2 = qddot, exactly, where q is free of noise. All three signs
/// are that of sigma. Sampled: the chain of integrators exactly from sample to sample, then the
/// three corrections, with sigma at the new sample, times the time passed.
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

  /// L: the third derivative of an oscillation by 1 rad at the bandwidth.
  static Gains tuned(const Tuning& t) { return {t.kp(), t.kd(), t.each(std::pow(t.w, 3))}; }

  LevantDifferentiator(const Gains& gains, const Settings& settings)
      : lipschitz_(gains.lipschitz), period_s_(settings.period_s) {}

  [[nodiscard]] Memory start(const Vector& q, const ReferencePoint& reference) const {
    return moved({q, reference.v_ref, reference.a_ref}, -period_s_);
  }

  [[nodiscard]] Memory step(const Memory& memory, const Vector& q, int ticks) const {
    const double time_s = ticks * period_s_;
    Memory next = moved(memory, time_s);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const double sigma = next.z0[i] - q[i];
      if (sigma == 0) continue;
      const double c0 = 2 * std::cbrt(lipschitz_[i] * sigma * sigma);  // |z1 - v0|
      const double c1 = 1.5 * std::sqrt(lipschitz_[i] * c0);           // |z2 - v1|
      const double towards_q = std::copysign(time_s, -sigma);
      next.z0[i] += towards_q * c0;
      next.z1[i] += towards_q * c1;
      next.z2[i] += towards_q * 1.1 * lipschitz_[i];
    }
    return next;
  }

  [[nodiscard]] Vector velocity(const Memory& memory) const { return memory.z1; }

 private:
  /// Without corrections.
  static Memory moved(const Memory& from, double time_s) {
    return {from.z0 + time_s * (from.z1 + time_s / 2 * from.z2), from.z1 + time_s * from.z2,
            from.z2};
  }

  Vector lipschitz_;
  double period_s_;
};

/// `EstimatedVelocity` by an exact differentiator, `source`, with the coefficients (l2, l1, l0) =
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
