#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "controller/law/filter.h"
#include "controller/law/flexible_robot.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "robot/inverse_dynamics.h"

namespace tachless::controller::law {

/// Regulation of a robot with flexible joints from motor positions alone: R. Kelly, R. Ortega,
/// A. Ailon and A. Loria, "Global regulation of flexible joint robots using approximate
/// differentiation", IEEE Trans. Automatic Control 39(6), 1994:
///
///   tau = g(q_ref) - Kp (theta - theta_ref) - Kd nu,   theta_ref = q_ref + K^-1 g(q_ref),
///   nudot = -A nu + B thetadot,   q_ref constant.
///
/// Measures: motor position; the links are not measured at all. Memory: the filter. Conditions: a
/// constant reference, and lambda_min [K, -K; -K, K + Kp] > k_g, the largest gradient of g. It is
/// constant by assumption, so a feed-forward lead changes nothing.
class KellyFlexible {
 public:
  static constexpr std::string_view name = "kelly_flexible";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"nu", "rad/s"}};  ///< of the motor
  static constexpr bool regulation_only = true;
  static constexpr bool has_feedforward_lead = true;

  using Robot = FlexibleRobot;
  using Measurement = loop::MotorPositionMeasurement;
  using Memory = Filter::Memory;

  struct Gains {
    robot::Vector kp;  ///< [N m/rad]
    robot::Vector kd;  ///< [N m s/rad]
    robot::Vector a;   ///< filter pole [1/s]
    robot::Vector b;   ///< filter gain [1/s]

    static constexpr std::array<GainName<Gains>, 4> names{
        {{"kp", &Gains::kp}, {"kd", &Gains::kd}, {"a", &Gains::a}, {"b", &Gains::b}}};
  };

  KellyFlexible(Robot robot, Gains gains, const Settings& settings)
      : robot_(std::move(robot)),
        gains_(std::move(gains)),
        filter_(gains_.a, gains_.b, settings.filter, settings.filter_start, settings.period_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    return filter_.start(measurement.theta - theta_ref(reference, gravity(reference)));
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    const robot::Vector g = gravity(reference);
    const robot::Vector e = measurement.theta - theta_ref(reference, g);
    Step<Memory> result{filter_.step(memory, e, ticks), {}, {}};
    const robot::Vector& nu = result.memory.nu;
    result.command.tau = g - gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(nu);
    result.signals = {signals.size(), {e, nu}};
    return result;
  }

 private:
  [[nodiscard]] robot::Vector gravity(const loop::ReferencePoint& reference) const {
    return robot::gravity_torque(robot_.links, reference.q_ref);
  }

  [[nodiscard]] robot::Vector theta_ref(const loop::ReferencePoint& reference,
                                        const robot::Vector& g) const {
    return reference.q_ref + g.cwiseQuotient(robot_.stiffness);
  }

  Robot robot_;
  Gains gains_;
  Filter filter_;
};

static_assert(OutputFeedbackLaw<KellyFlexible>);

}  // namespace tachless::controller::law
