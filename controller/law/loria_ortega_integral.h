#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/filtered_error.h"
#include "controller/law/passive_integral.h"

namespace tachless::controller::law {

struct IntegralGains {
  Vector kp, kd, a, b, ki;
  double eps_1 = 0, eps_2 = 0;
  Vector d_max = {};
  double w = 0, damping = 0;

  static constexpr std::tuple keys{
      gain_beside_w("kp", &IntegralGains::kp, "N m/rad", "Weight of the position error"),
      gain_beside_w("kd", &IntegralGains::kd, "N m s/rad", "Weight of the filter output"),
      gain("a", &IntegralGains::a, "1/s", "Filter pole"),
      gain("b", &IntegralGains::b, "1/s", "Filter gain"),
      gain("ki", &IntegralGains::ki, "N m/rad", "Weight of the integral"),
      gain("eps_1", &IntegralGains::eps_1, "1/s", "Weight of e in what is integrated"),
      gain("eps_2", &IntegralGains::eps_2, "1", "Weight of nu in what is integrated"),
      gain("d_max", &IntegralGains::d_max, "N m", "Largest torque of the integral")
          .by_default("the drive's limit"),
      bandwidth_key(&IntegralGains::w),
      damping_key(&IntegralGains::damping)};
};

/// `LoriaOrtegaRigid` with an integral that compensates constant torques unknown to the model, from
/// link positions alone:
///
///   tau = ID(q, v_ref, vdot_ref) - Kp e - Kd nu - Ki y,   y = e - e(0) + int (eps_1 e - eps_2 nu).
///
/// `PassiveIntegral` computes y. `FollowingGains` adds gains that follow the reference to Kp and
/// Kd, where w is given.
///
/// Two rules keep y from winding up. |Ki y| is at most `d_max`, the largest unknown torque. A
/// component of y does not change if the command exceeds the drive's limit and the change would
/// increase the command.
class LoriaOrtegaIntegral : public FollowingGains<LoriaOrtegaIntegral, IntegralGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_integral";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"},
                                      Signal{"integral", "N m"}};
  static constexpr std::string_view source =
      "derived here from A. Loria and R. Ortega, Appl. Math. and Comp. Sci. 5(2), 1995; in the "
      "line of R. Ortega, A. Loria and R. Kelly, A semiglobally stable output feedback PI2D "
      "regulator for robot manipulators, IEEE Trans. Automatic Control 40(8), 1995";
  static constexpr std::string_view proved =
      "asymptotically stable with constant unknown torques, from a certified region, in "
      "continuous time";
  static constexpr std::string_view conditions =
      "the matrix condition holds with the law's own eps_1 and eps_2; V(0) + 1/2 d' Ki^-1 d is at "
      "most the certified level, d the unknown torque";

  struct Memory {
    Filter::Memory filter;
    Vector y;  ///< [rad]

    static constexpr std::tuple members{&Memory::filter, &Memory::y};
  };
  LoriaOrtegaIntegral(robot::Model robot, IntegralGains gains, const Settings& settings)
      : FollowingGains(std::move(robot), std::move(gains), settings),
        limit_(settings.torque_limit.size() > 0 ? settings.torque_limit : each(infinity)),
        integral_{gains_.ki,        gains_.eps_1, gains_.eps_2,
                  gains_.a,         gains_.b,     gains_.d_max.size() > 0 ? gains_.d_max : limit_,
                  settings.period_s} {}

  static Gains tuned(const Tuning& t) {
    const double eps_1 = t.w / 3;
    return {t.kp(),        t.kd(), t.each(t.filter),    t.each(t.filter),
            0.25 * t.kp(), eps_1,  5 * eps_1 / t.filter};
  }

  /// Returns the memory with which y(0) = 0 after the first step.
  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Filter::Memory filter = FilteredError::start(measured, reference);
    const Vector e = measured.q - reference.q_ref;
    return {filter, integral_.before_zero(filter, filter_.step(filter, e))};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    auto [filter, command, logged] = FilteredError::step(memory.filter, measured, reference);
    Vector outside = command.tau;  // of the integral
    if (settings_.friction.given()) outside += friction(reference);
    const Vector free = integral_.next(memory.y, memory.filter, filter);
    const Vector y = without_windup(memory.y, free, outside);
    const Vector torque = integral_.torque(y);
    command.tau += torque;
    return {{filter, y}, command, {signals.size(), {logged.value[0], filter.nu, torque}}};
  }

  /// Returns the law's integral.
  [[nodiscard]] const PassiveIntegral* integral() const { return &integral_; }

  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė + ½ τ′Ki⁻¹τ of the integral";
  /// Returns V with the law's own weights, for an unknown torque of zero [J].
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    return FilteredError::lyapunov(state, reference, integral_.weights()) +
           integral_.lyapunov(state.controller.value[2]);
  }

 private:
  /// Returns `free`, with the component of `before` wherever the command exceeds the drive's limit
  /// and the change would increase the command.
  /// @param outside the command without the integral [N m]
  [[nodiscard]] Vector without_windup(const Vector& before, const Vector& free,
                                      const Vector& outside) const {
    Vector y = free;
    const Vector held = integral_.within(before), command = outside + integral_.torque(free);
    for (Eigen::Index i = 0; i < y.size(); ++i) {
      const bool outwards =
          command[i] > limit_[i] ? y[i] < before[i] : command[i] < -limit_[i] && y[i] > before[i];
      if (outwards) y[i] = held[i];
    }
    return y;
  }

  Vector limit_;  ///< [N m]
  PassiveIntegral integral_;
};

static_assert(OutputFeedbackLaw<LoriaOrtegaIntegral>);

}  // namespace tachless::controller::law
