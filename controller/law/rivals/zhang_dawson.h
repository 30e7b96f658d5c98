#pragma once

#include <algorithm>
#include <array>
#include <string_view>
#include <tuple>

#include "base/elementary.h"
#include "controller/law/parts.h"

namespace tachless::controller::law {

struct ZhangDawsonGains {
  Vector k;

  static constexpr std::tuple keys{
      gain("k", &ZhangDawsonGains::k, "1/s", "Pole of the filter, and weight of its output [N m]")};
};

/// Global tracking of a rigid robot from link positions alone (`source`), joint by joint. Here e =
/// q - q_ref; the source uses the other sign.
///
///   y = p + k e,   pdot = -(1 - y^2)(y + tanh e) + k (tanh e - y),   y(0) = 0,
///   tau = ID(q_ref, v_ref, vdot_ref) - k y / (1 - y^2) - tanh e.
///
/// The law is not defined for |y| >= 1. The torque is infinite there, and an infinite torque ends
/// the run.
///
/// With `feedforward_lead_s`, the first term uses v_ref and vdot_ref at that time ahead; q_ref is
/// not taken ahead.
class ZhangDawson : public RigidLaw<ZhangDawsonGains> {
 public:
  static constexpr std::string_view name = "zhang_dawson";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"y", ""}};
  static constexpr std::string_view source =
      "F. Zhang, D. M. Dawson, M. S. de Queiroz and W. E. Dixon, Global adaptive output feedback "
      "tracking control of robot manipulators, IEEE Trans. Automatic Control 45(6), 2000, without "
      "its adaptation, in the form implemented here";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "k large enough, by the bounds of the robot's model and of the reference; the source's robot "
      "has viscous friction";

  using Measurement = messages::PositionMeasurement;

  struct Memory {
    Vector y;           ///< in (-1, 1) where the law is defined
    Vector e_previous;  ///< [rad]; empty before the first step

    static constexpr std::tuple members{&Memory::y, &Memory::e_previous};
  };

  using LawOf::LawOf;

  /// Sets k to the filter's pole; no k makes the errors decay faster than exp(-t).
  static Gains tuned(const Tuning& t) { return {t.each(t.filter)}; }

  [[nodiscard]] Memory start(const Measurement& measured,
                             const ReferencePoint& /*reference*/) const {
    return {Vector::Zero(measured.q.size()), {}};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    Vector y = memory.y;
    if (memory.e_previous.size() > 0) {
      for (Eigen::Index i = 0; i < y.size(); ++i) {
        y[i] = filtered(y[i], gains_.k[i], memory.e_previous[i], e[i]);
      }
    }
    const auto [v_ref, a_ref] = ahead(reference);
    Vector tau = robot::inverse_dynamics(robot_, reference.q_ref, v_ref, a_ref);
    for (Eigen::Index i = 0; i < y.size(); ++i) {
      const double distance = std::max(0.0, 1 - y[i] * y[i]);  // 0: not defined, an infinite torque
      tau[i] -= gains_.k[i] * y[i] / distance + base::tanh(e[i]);
    }
    return {{y, e}, {tau}, {signals.size(), {e, y}}};
  }

 private:
  /// Returns y after a period in which e moves linearly from `e_from` to `e_to`:
  ///   ydot = k (edot + tanh e - y) - (1 - y^2)(y + tanh e).
  /// The exponential midpoint rule is exact for the terms in k and of order two for the other
  /// terms.
  [[nodiscard]] double filtered(double y, double k, double e_from, double e_to) const {
    const double h = settings_.period_s;
    const double slope = e_to - e_from;  // change of e in a period
    const auto after = [&](double time_s, double at_y, double e) {
      const double t = base::tanh(e);
      const double target = slope / h + t - (1 - at_y * at_y) * (at_y + t) / k;
      return target + base::exp(-k * time_s) * (y - target);
    };
    const double middle = after(h / 2, y, e_from);
    return after(h, middle, e_from + slope / 2);
  }
};

static_assert(OutputFeedbackLaw<ZhangDawson>);

}  // namespace tachless::controller::law
