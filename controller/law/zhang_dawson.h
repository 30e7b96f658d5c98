#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Global tracking of a rigid robot from link positions alone: F. Zhang, D. M. Dawson, M. S. de
/// Queiroz and W. E. Dixon, "Global adaptive output feedback tracking control of robot
/// manipulators", IEEE Trans. Automatic Control 45(6), 2000, without its adaptation, in the form
/// implemented here, with e = q - q_ref (the source's has the other sign), joint by joint:
///
///   y = p + k e,   pdot = -(1 - y^2)(y + tanh e) + k (tanh e - y),   y(0) = 0,
///   tau = ID(q_ref, v_ref, vdot_ref) - k y / (1 - y^2) - tanh e.
///
/// Where |y| >= 1 the law is not defined: its torque is infinite there, which ends the run.
///
/// Measures: link position. Memory: y and the error of the sample before. With
/// `feedforward_lead_s`, v_ref and vdot_ref of the first term are taken that much ahead; q_ref is
/// not.
class ZhangDawson {
 public:
  static constexpr std::string_view name = "zhang_dawson";
  static constexpr std::array signals = {loop::Signal{"error", "rad"}, loop::Signal{"y", ""}};
  static constexpr std::string_view source =
      "F. Zhang, D. M. Dawson, M. S. de Queiroz and W. E. Dixon, Global adaptive output feedback "
      "tracking control of robot manipulators, IEEE Trans. Automatic Control 45(6), 2000, without "
      "its adaptation, in the form implemented here";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "k large enough, by the bounds of the robot's model and of the reference; the source's robot "
      "has viscous friction";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J
  using Measurement = loop::PositionMeasurement;

  struct Memory {
    robot::Vector y;           ///< in (-1, 1) where the law is defined
    robot::Vector e_previous;  ///< [rad]; empty before the first step

    static constexpr std::tuple members{&Memory::y, &Memory::e_previous};
  };

  struct Gains {
    robot::Vector k;

    static constexpr std::tuple keys{
        schema::Key{"k", &Gains::k, "1/s", "Pole of the filter, and weight of its output [N m]"}.in(
            schema::positive)};
  };

  /// The filter's pole: no k makes its errors decay faster than exp(-t).
  static Gains tuned(const Tuning& t) { return {t.each(t.filter)}; }

  ZhangDawson(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)),
        gains_(std::move(gains)),
        lead_s_(settings.feedforward_lead_s),
        period_s_(settings.period_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& /*reference*/) const {
    return {robot::Vector::Zero(measurement.q.size()), {}};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    Step<Memory> result{{memory.y, e}, {}, {}};
    robot::Vector& y = result.memory.y;
    if (memory.e_previous.size() > 0) {
      for (Eigen::Index i = 0; i < y.size(); ++i) {
        y[i] = filtered(y[i], gains_.k[i], memory.e_previous[i], e[i], ticks);
      }
    }
    result.command.tau = robot::inverse_dynamics(model_, reference.q_ref, ahead.v_ref, ahead.a_ref);
    for (Eigen::Index i = 0; i < y.size(); ++i) {
      const double distance = std::max(0.0, 1 - y[i] * y[i]);  // 0: not defined, an infinite torque
      result.command.tau[i] -= gains_.k[i] * y[i] / distance + std::tanh(e[i]);
    }
    result.signals = {signals.size(), {e, y}};
    return result;
  }

 private:
  /// y after `ticks` periods in which e goes straight from `e_from` to `e_to`:
  ///   ydot = k (edot + tanh e - y) - (1 - y^2)(y + tanh e),
  /// period by period by the exponential midpoint rule: exact for the terms in k, of order two for
  /// the rest.
  [[nodiscard]] double filtered(double y, double k, double e_from, double e_to, int ticks) const {
    const double slope = (e_to - e_from) / ticks;  // of a period
    const auto after = [&](double time_s, double at_y, double e) {
      const double t = std::tanh(e);
      const double target = slope / period_s_ + t - (1 - at_y * at_y) * (at_y + t) / k;
      return target + std::exp(-k * time_s) * (y - target);
    };
    for (int i = 0; i < ticks; ++i) {
      const double e_now = e_from + i * slope;
      const double middle = after(period_s_ / 2, y, e_now);
      y = after(period_s_, middle, e_now + slope / 2);
    }
    return y;
  }

  robot::Model model_;
  Gains gains_;
  double lead_s_;
  double period_s_;
};

static_assert(OutputFeedbackLaw<ZhangDawson>);

}  // namespace tachless::controller::law
