#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"

namespace tachless::controller::law {

struct MotorPdFeedforwardGains {
  Vector kp, kv;

  static constexpr std::tuple keys{
      gain("kp", &MotorPdFeedforwardGains::kp, "N m/rad", "Weight of the motor's position error"),
      gain("kv", &MotorPdFeedforwardGains::kv, "N m s/rad",
           "Weight of the motor's velocity error")};
};

/// Tracking of a robot with flexible joints by a proportional-derivative law of the motors and a
/// feed-forward. The feed-forward is a function of the reference alone:
///
///   theta_ref = q_ref + K^-1 ID(q_ref, v_ref, vdot_ref),
///   tau = J thetaddot_ref + K (theta_ref - q_ref) - Kp e2 - Kv e2dot,   e2 = theta - theta_ref.
///
/// The law measures the full state, because no smaller measurement holds motor velocity. It uses
/// motor position and velocity only.
class MotorPdFeedforward : public FlexibleLaw<MotorPdFeedforwardGains>, public FullState {
 public:
  static constexpr std::string_view name = "motor_pd_feedforward";
  static constexpr std::array signals{Signal{"error", "rad"},
                                      Signal{"edot", "rad/s"}};  ///< the motor's
  static constexpr std::string_view source =
      "common practice; the idea of a feed-forward of the reference alone is in L. Lanari and J. "
      "T. "
      "Wen, 1992-1993, whose laws were not compared with it";
  static constexpr std::string_view proved = "locally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "K and Kp large beside the gradients of the links' torque on the reference; the region grows "
      "with Kp and Kv; a reference that is four times continuously differentiable";

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) {
    const auto [kp, kv] = t.through_spring();
    return {kp, kv};
  }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    // Torque of the links on the reference, K (theta_ref - q_ref), with two derivatives.
    const robot::JetVector torque = feedforward_torque(robot_.links, reference);
    const robot::JetVector theta_ref =
        ReferenceJets(reference).q + torque.cwiseQuotient(robot_.stiffness);
    const Vector e = measured.theta - robot::value(theta_ref);
    const Vector edot = measured.thetadot - robot::first_derivative(theta_ref);
    const Vector tau = robot_.rotor_inertia.cwiseProduct(robot::second_derivative(theta_ref)) +
                       robot::value(torque) - gains_.kp.cwiseProduct(e) -
                       gains_.kv.cwiseProduct(edot);
    return {{}, {tau}, {signals.size(), {e, edot}}};
  }
};

static_assert(Law<MotorPdFeedforward>);
static_assert(!OutputFeedbackLaw<MotorPdFeedforward>);

}  // namespace tachless::controller::law
