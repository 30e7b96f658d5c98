#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/flexible_robot.h"
#include "controller/law/full_state.h"
#include "controller/law/law.h"
#include "controller/law/lyapunov.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/forward_dynamics.h"
#include "robot/inverse_dynamics.h"
#include "robot/jet.h"
#include "robot/mass_matrix.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Tracking of a robot with flexible joints with the full state and link jerk: the passivity-based
/// law of Lozano and Brogliato (1992-1995), in the form implemented here,
///
///   theta_ref = q_ref + K^-1 [ M v_rdot + C(q, v) v_r + g - Ks1 s1 ],  v_r = v_ref - Lambda e1,
///   tau = J thetaddot_r + K (theta_ref - q_ref) - Ks2 s2,  thetadot_r = thetadot_ref - Lambda e2,
///   s1 = v - v_r,  s2 = thetadot - thetadot_r,  e1 = q - q_ref,  e2 = theta - theta_ref.
///
/// The contrast to `LoriaOrtegaFlexible`: theta_ref holds link velocity, so its second derivative
/// holds link jerk, which is computed from the model and from motor velocity.
///
/// Measures: the full state. Memory: none.
class SlotineLiFlexible : public FullState {
 public:
  static constexpr std::string_view name = "slotine_li_flexible";
  static constexpr std::array signals = {
      loop::Signal{"error_1", "rad"}, loop::Signal{"edot_1", "rad/s"},
      loop::Signal{"error_2", "rad"}, loop::Signal{"edot_2", "rad/s"}};  ///< 1: link, 2: motor
  static constexpr std::string_view source =
      "R. Lozano and B. Brogliato, 1992-1995 (passivity-based control of flexible joints), in the "
      "form implemented here";
  static constexpr std::string_view proved = "globally exponentially stable, in continuous time";
  static constexpr std::string_view conditions =
      "any positive gains, the same diagonal Lambda on links and motors; a reference that is four "
      "times continuously differentiable";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = false;

  using Robot = FlexibleRobot;

  struct Gains {
    robot::Vector lambda, ks1, ks2;

    static constexpr std::tuple keys{
        schema::Key{"lambda", &Gains::lambda, "1/s",
                    "Weight of a position error in s = edot + lambda e; the same on link and motor"}
            .in(schema::positive),
        schema::Key{"ks1", &Gains::ks1, "N m s/rad", "Weight of the link's s"}.in(schema::positive),
        schema::Key{"ks2", &Gains::ks2, "N m s/rad", "Weight of the motor's s"}.in(
            schema::positive)};
  };

  static Gains tuned(const Tuning& t) {
    return {t.each(t.w / t.damping), t.damping * t.w * t.inertia, t.motor_kd()};
  }

  SlotineLiFlexible(Robot robot, Gains gains, const Settings& /*settings*/)
      : robot_(std::move(robot)), gains_(std::move(gains)) {}

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const robot::Vector& v = measurement.v;
    const robot::JetVector theta_ref = motor_reference(measurement, reference);
    const robot::Vector e2 = measurement.theta - robot::value(theta_ref);
    const robot::Vector e2dot = measurement.thetadot - robot::first_derivative(theta_ref);
    const robot::Vector s2 = e2dot + gains_.lambda.cwiseProduct(e2);
    const robot::Vector thetaddot_r =
        robot::second_derivative(theta_ref) - gains_.lambda.cwiseProduct(e2dot);

    Step<Memory> result;
    result.command.tau = robot_.rotor_inertia.cwiseProduct(thetaddot_r) +
                         robot_.spring_torque(reference.q_ref, robot::value(theta_ref)) -
                         gains_.ks2.cwiseProduct(s2);
    result.signals = {signals.size(),
                      {measurement.q - reference.q_ref, v - reference.v_ref, e2, e2dot}};
    return result;
  }

  /// Link jerk by the model [rad/s^3]: the first line of eq. 1, differentiated once.
  [[nodiscard]] robot::Vector link_jerk(const Measurement& measurement,
                                        const robot::Vector& vdot) const {
    const robot::Vector& q = measurement.q;
    const robot::Vector& v = measurement.v;
    const robot::Vector zero = robot::Vector::Zero(q.size());
    // d/dt ID(q, v, vdot) = M jerk + what is left when jerk is taken for zero.
    const robot::Vector rest = robot::first_derivative(
        robot::inverse_dynamics(robot_.links, robot::jet(q, v, vdot), robot::jet(v, vdot, zero),
                                robot::jet(vdot, zero, zero)));
    const robot::Vector spring_rate = robot_.spring_torque(v, measurement.thetadot);
    // M^-1 x = forward dynamics at rest under x + g.
    return robot::forward_dynamics(
        robot_.links, q, zero,
        robot::Vector(spring_rate - rest + robot::gravity_torque(robot_.links, q)));
  }

  /// theta_ref [rad] with its first and second time derivative.
  [[nodiscard]] robot::JetVector motor_reference(const Measurement& measurement,
                                                 const loop::ReferencePoint& reference) const {
    const robot::Vector& q = measurement.q;
    const robot::Vector& v = measurement.v;
    const robot::Vector vdot =
        robot::forward_dynamics(robot_.links, q, v, robot_.spring_torque(q, measurement.theta));
    const robot::Vector jerk = link_jerk(measurement, vdot);

    const robot::JetVector q_jet = robot::jet(q, v, vdot);
    const robot::JetVector v_jet = robot::jet(v, vdot, jerk);
    const robot::JetVector q_ref = robot::jet(reference.q_ref, reference.v_ref, reference.a_ref);
    const robot::JetVector v_ref = robot::jet(reference.v_ref, reference.a_ref, reference.jerk_ref);
    const robot::JetVector a_ref =
        robot::jet(reference.a_ref, reference.jerk_ref, reference.snap_ref);
    robot::JetVector v_r(q.size()), a_r(q.size());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      v_r[i] = v_ref[i] - gains_.lambda[i] * (q_jet[i] - q_ref[i]);
      a_r[i] = a_ref[i] - gains_.lambda[i] * (v_jet[i] - v_ref[i]);
    }
    robot::JetVector torque =
        robot::inverse_dynamics_bilinear(robot_.links, q_jet, v_jet, v_r, a_r);
    robot::JetVector theta_ref(q.size());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      torque[i] -= gains_.ks1[i] * (v_jet[i] - v_r[i]);
      theta_ref[i] = q_ref[i] + torque[i] / robot_.stiffness[i];
    }
    return theta_ref;
  }

  /// Vdot = -s1' Ks1 s1 - s2' Ks2 s2 - (e1 - e2)' Lambda K (e1 - e2).
  static constexpr std::string_view lyapunov_formula =
      "½ s₁′M s₁ + ½ s₂′J s₂ + ½ (e₁ − e₂)′K (e₁ − e₂),  s = ė + Λ e";
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const robot::JetVector theta_ref =
        motor_reference({state.q, state.v, state.theta, state.thetadot}, reference);
    const robot::Vector e1 = state.q - reference.q_ref;
    const robot::Vector e2 = state.theta - robot::value(theta_ref);
    const robot::Vector s1 = state.v - reference.v_ref + gains_.lambda.cwiseProduct(e1);
    const robot::Vector s2 =
        state.thetadot - robot::first_derivative(theta_ref) + gains_.lambda.cwiseProduct(e2);
    return 0.5 * s1.dot(robot::mass_matrix(robot_.links, state.q) * s1) +
           0.5 * weighted(robot_.rotor_inertia, s2) + 0.5 * weighted(robot_.stiffness, e1 - e2);
  }

 private:
  Robot robot_;
  Gains gains_;
};

static_assert(Law<SlotineLiFlexible>);
static_assert(!OutputFeedbackLaw<SlotineLiFlexible>);

}  // namespace tachless::controller::law
