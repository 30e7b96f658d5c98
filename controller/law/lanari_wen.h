#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/flexible_robot.h"
#include "controller/law/full_state.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Tracking of a robot with flexible joints from motor position and velocity, with everything
/// beside them taken from the reference: of the laws of L. Lanari and J. T. Wen (1992-1993) the one
/// with all-desired feed-forward, in the form implemented here,
///
///   theta_ref = q_ref + K^-1 ID(q_ref, v_ref, vdot_ref),
///   tau = J thetaddot_ref + K (theta_ref - q_ref) - Kp e2 - Kv e2dot,   e2 = theta - theta_ref.
///
/// Measures: the full state, since no lesser measurement holds motor velocity; uses motor position
/// and velocity alone. Memory: none.
class LanariWen : public FullState {
 public:
  static constexpr std::string_view name = "lanari_wen";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"edot", "rad/s"}};  ///< of the motor
  static constexpr std::string_view source =
      "L. Lanari and J. T. Wen, 1992-1993 (flexible joints, all-desired feed-forward), in the form "
      "implemented here";
  static constexpr std::string_view proved = "locally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "K and Kp large beside the gradients of the links' torque on the reference; the region grows "
      "with Kp and Kv; a reference that is four times continuously differentiable";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = false;

  using Robot = FlexibleRobot;

  struct Gains {
    robot::Vector kp, kv;

    static constexpr std::tuple keys{
        schema::Key{"kp", &Gains::kp, "N m/rad", "Weight of the motor's position error"}.in(
            schema::positive),
        schema::Key{"kv", &Gains::kv, "N m s/rad", "Weight of the motor's velocity error"}.in(
            schema::positive)};
  };

  static Gains tuned(const Tuning& t) {
    const auto [kp, kv] = t.through_spring();
    return {kp, kv};
  }

  LanariWen(Robot robot, Gains gains, const Settings& /*settings*/)
      : robot_(std::move(robot)), gains_(std::move(gains)) {}

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const loop::ReferencePoint& r = reference;
    // Of the links on the reference, with two derivatives: K (theta_ref - q_ref).
    const robot::JetVector torque = feedforward_torque(robot_.links, r);
    const robot::Vector& K = robot_.stiffness;
    const robot::Vector e = measurement.theta - (r.q_ref + robot::value(torque).cwiseQuotient(K));
    const robot::Vector edot =
        measurement.thetadot - (r.v_ref + robot::first_derivative(torque).cwiseQuotient(K));
    const robot::Vector thetaddot_ref = r.a_ref + robot::second_derivative(torque).cwiseQuotient(K);

    Step<Memory> result;
    result.command.tau = robot_.rotor_inertia.cwiseProduct(thetaddot_ref) + robot::value(torque) -
                         gains_.kp.cwiseProduct(e) - gains_.kv.cwiseProduct(edot);
    result.signals = {signals.size(), {e, edot}};
    return result;
  }

 private:
  Robot robot_;
  Gains gains_;
};

static_assert(Law<LanariWen>);
static_assert(!OutputFeedbackLaw<LanariWen>);

}  // namespace tachless::controller::law
