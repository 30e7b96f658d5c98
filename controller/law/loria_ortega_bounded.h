#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/filtered_error.h"
#include "controller/law/passive_integral.h"

namespace tachless::controller::law {

struct BoundedGains {
  Vector kp, kd, a, b;
  Vector feedforward_max;
  double linear = 0.8;
  Vector ki = {};
  double eps_1 = 0, eps_2 = 0;
  Vector d_max = {};

  static constexpr std::tuple keys{
      gain("kp", &BoundedGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &BoundedGains::kd, "N m s/rad", "Weight of the filter output"),
      gain("a", &BoundedGains::a, "1/s", "Filter pole"),
      gain("b", &BoundedGains::b, "1/s", "Filter gain"),
      gain("feedforward_max", &BoundedGains::feedforward_max, "N m",
           "Largest torque of the feed-forward, below the drive's limit")
          .by_default("7/10 of the drive's limit, less d_max"),
      base::Key{"linear", &BoundedGains::linear, "1",
                "Share of the feedback's torque up to which the feedback is linear"}
          .in({0, 1, true, true})
          .by_default(),
      gain("ki", &BoundedGains::ki, "N m/rad", "Weight of the integral").by_default("no integral"),
      base::Key{"eps_1", &BoundedGains::eps_1, "1/s", "Weight of e in what is integrated"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"eps_2", &BoundedGains::eps_2, "1", "Weight of nu in what is integrated"}
          .in(base::not_negative)
          .by_default(),
      gain("d_max", &BoundedGains::d_max, "N m", "Largest torque of the integral")
          .by_default("required with ki")};
};

/// `LoriaOrtegaRigid` whose torque stays within the drives' limits for every input:
///
///   tau = clip(ID(q, v_ref, vdot_ref), +-F) + S(-Kp e - Kd nu) - Ki y,   F + L + d_max = limit,
///   S(u) = u for |u| <= k L, and sign(u) [k L + (1 - k) L tanh((|u| - k L) / ((1 - k) L))] beyond.
///
/// The friction that is fed forward is part of ID. S is continuously differentiable, strictly
/// increasing and bounded by L. F is `feedforward_max` and k is `linear`. The integral y is
/// optional and projected onto |Ki y| <= d_max. The law is `LoriaOrtegaRigid`, or
/// `LoriaOrtegaIntegral` with ki, while the clip does not act and |Kp e + Kd nu| <= k L.
class LoriaOrtegaBounded : public FilteredError<LoriaOrtegaBounded, BoundedGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_bounded";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"},
                                      Signal{"feedback", "N m"}, Signal{"integral", "N m"}};
  static constexpr std::string_view source =
      "derived here from A. Loria and R. Ortega, On tracking control of rigid and flexible joint "
      "robots, Appl. Math. and Comp. Sci. 5(2), 1995, eq. 4-5";
  static constexpr std::string_view proved =
      "torque within the limits; globally convergent where the reference comes to rest or friction "
      "is large enough, else exponentially stable in a certified region, in continuous time";
  static constexpr std::string_view conditions =
      "|ID(q, v_ref, vdot_ref)| is below feedforward_max at every posture along the reference; for "
      "the region the matrix condition, within the level where the feedback is linear; with ki "
      "only "
      "the region, as for loria_ortega_integral";
  static constexpr bool feeds_friction = true, needs_torque_limit = true;

  struct Memory {
    Filter::Memory filter;
    Vector y;  ///< [rad]; zero without an integral

    static constexpr std::tuple members{&Memory::filter, &Memory::y};
  };

  /// @throw std::invalid_argument if a drive has no limit, if feedforward_max and d_max reach it,
  /// or if the integral is given in part.
  LoriaOrtegaBounded(robot::Model robot, BoundedGains gains, const Settings& settings)
      : FilteredError(std::move(robot), std::move(gains), settings) {
    const Vector& limit = settings_.torque_limit;
    if (limit.size() == 0 || !limit.allFinite()) {
      throw std::invalid_argument("a joint has no torque limit");
    }
    Vector taken = each(0);
    if (gains_.ki.size() > 0) {
      if (gains_.d_max.size() == 0 || !(gains_.eps_1 > 0) || !(gains_.eps_2 > 0)) {
        throw std::invalid_argument("ki needs eps_1, eps_2 and d_max, all greater than 0");
      }
      taken = gains_.d_max;
      integral_ = PassiveIntegral{gains_.ki, gains_.eps_1, gains_.eps_2,      gains_.a,
                                  gains_.b,  gains_.d_max, settings_.period_s};
    }
    feedforward_max_ =
        gains_.feedforward_max.size() > 0 ? gains_.feedforward_max : Vector(0.7 * limit - taken);
    feedback_max_ = limit - feedforward_max_ - taken;
    if (!(feedback_max_.array() > 0).all() || !(feedforward_max_.array() > 0).all()) {
      throw std::invalid_argument(
          "feedforward_max and d_max reach plant.drive.torque_limit_Nm; they have to leave a "
          "torque "
          "for the feedback");
    }
  }

  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), t.each(t.filter), t.each(t.filter), {}, 0.8};
  }

  /// Returns the memory with which y is 0 after the first step.
  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Filter::Memory filter = FilteredError::start(measured, reference);
    if (!integral_) return {filter, each(0)};
    const Vector e = measured.q - reference.q_ref;
    return {filter, integral_->before_zero(filter, filter_.step(filter, e))};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    Memory next{filter_.step(memory.filter, e), each(0)};
    Vector taken_up = each(0);
    if (integral_) {
      next.y = integral_->next(memory.y, memory.filter, next.filter);
      taken_up = integral_->torque(next.y);
    }
    Vector torque = feedforward(measured.q, reference);
    if (settings_.friction.given()) torque += friction(reference);
    const Vector back = bounded(feedback(each(0), e, next.filter.nu, reference));
    const Vector tau =
        torque.cwiseMax(-feedforward_max_).cwiseMin(feedforward_max_) + back + taken_up;
    return {next, {tau}, {signals.size(), {e, next.filter.nu, back, taken_up}}};
  }

  /// Returns S(u) [N m].
  [[nodiscard]] Vector bounded(const Vector& u) const {
    Vector result = u;
    for (Eigen::Index i = 0; i < u.size(); ++i) {
      const double linear = gains_.linear * feedback_max_[i], rest = feedback_max_[i] - linear;
      const double beyond = std::abs(u[i]) - linear;
      if (beyond > 0) result[i] = std::copysign(linear + rest * base::tanh(beyond / rest), u[i]);
    }
    return result;
  }

  /// Returns the largest torque of the feed-forward, F [N m].
  [[nodiscard]] const Vector& feedforward_max() const { return feedforward_max_; }
  /// Returns the torque up to which the feedback is linear, k L [N m].
  [[nodiscard]] Vector linear_feedback() const { return gains_.linear * feedback_max_; }
  /// Returns the largest torque of the feedback, L [N m].
  [[nodiscard]] const Vector& feedback_max() const { return feedback_max_; }
  /// Returns the law's integral; nullptr: the law has none.
  [[nodiscard]] const PassiveIntegral* integral() const {
    return integral_ ? &*integral_ : nullptr;
  }

  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė, with an integral + ½ τ′Ki⁻¹τ";
  /// Returns V where the feedback is linear; with an integral for an unknown torque of zero [J].
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    if (!integral_) return FilteredError::lyapunov(state, reference, weights);
    return FilteredError::lyapunov(state, reference, integral_->weights()) +
           integral_->lyapunov(state.controller.value[3]);
  }

 private:
  Vector feedforward_max_, feedback_max_;  ///< [N m]
  std::optional<PassiveIntegral> integral_;
};

static_assert(OutputFeedbackLaw<LoriaOrtegaBounded>);

}  // namespace tachless::controller::law
