#include "certificate/lyapunov.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "controller/laws.h"
#include "controller/registry.h"
#include "robot/energy.h"
#include "robot/forward_dynamics.h"
#include "robot/inverse_dynamics.h"
#include "robot/jet.h"
#include "robot/mass_matrix.h"

namespace tachless::certificate {
namespace {

using robot::Vector;

/// x' diag(d) x.
double weighted(const Vector& d, const Vector& x) { return x.dot(d.cwiseProduct(x)); }

/// The largest eigenvalue of M over postures spread evenly over the joints' ranges.
double largest_inertia(const robot::Model& model) {
  constexpr int num_postures = 256;
  // Fractional parts of multiples of roots of primes: Kronecker's sequence.
  constexpr std::array<int, 12> primes = {2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37};
  double largest = 0;
  for (int k = 0; k < num_postures; ++k) {
    Vector q(model.num_joints);
    for (int i = 0; i < model.num_joints; ++i) {
      const auto joint = static_cast<std::size_t>(i);
      const double step = std::sqrt(primes[joint % primes.size()] + i / 12);
      const double part = k * step - std::floor(k * step);
      const double range =
          model.joint_types[joint] == robot::JointType::revolute ? std::numbers::pi : 1.0;
      const double low = std::isfinite(model.lower[i]) ? model.lower[i] : -range;
      const double high = std::isfinite(model.upper[i]) ? model.upper[i] : range;
      q[i] = low + part * (high - low);
    }
    const robot::Matrix M = robot::mass_matrix(model, q);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(M, Eigen::EigenvaluesOnly);
    largest = std::max(largest, solver.eigenvalues().maxCoeff());
  }
  return largest;
}

double default_epsilon(double smallest_stiffness, double largest_mass) {
  return 0.05 * std::sqrt(smallest_stiffness / (2 * largest_mass));
}

struct Gains {
  Vector kp, kd, a, b;

  Gains(const experiment::Scenario& scenario, const std::string& suffix) {
    const auto& facts = controller::law_facts(scenario.controller.law);
    const auto gain = [&](const std::string& name) {
      return controller::required_gain(scenario, facts, name + suffix);
    };
    kp = gain("kp");
    kd = gain("kd");
    a = gain("a");
    b = gain("b");
  }
  [[nodiscard]] Vector kd_by_b() const { return kd.cwiseQuotient(b); }
};

LyapunovFunction rigid(const experiment::Scenario& scenario) {
  const auto model = std::make_shared<const robot::Model>(controller::rigid_model(scenario));
  const Gains gains(scenario, "");
  const double epsilon = default_epsilon(std::min(gains.kp.minCoeff(), gains.kd_by_b().minCoeff()),
                                         largest_inertia(*model));
  return {"½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε (e − ν)′Mė", epsilon,
          [model, kp = gains.kp, kd_by_b = gains.kd_by_b(), epsilon](
              const LoopState& state, const loop::ReferencePoint& reference) {
            const Vector e = state.q - reference.q_ref;
            const Vector edot = state.v - reference.v_ref;
            const Vector& nu = state.controller.value[1];
            const Vector momentum = robot::mass_matrix(*model, state.q) * edot;
            return 0.5 * edot.dot(momentum) + 0.5 * weighted(kp, e) + 0.5 * weighted(kd_by_b, nu) +
                   epsilon * (e - nu).dot(momentum);
          }};
}

struct Flexible {
  controller::law::FlexibleRobot robot;
  controller::law::LoriaOrtegaFlexible law;
  Gains link, motor;
  double epsilon = 0;

  explicit Flexible(const experiment::Scenario& scenario)
      : robot(controller::flexible_robot(scenario)),
        law(controller::make_law<controller::law::LoriaOrtegaFlexible>(scenario)),
        link(scenario, "1"),
        motor(scenario, "2") {
    // Kp is diag(Kp1, Kp2) and the springs' part, which only adds.
    epsilon =
        default_epsilon(std::min({link.kp.minCoeff(), motor.kp.minCoeff(),
                                  link.kd_by_b().minCoeff(), motor.kd_by_b().minCoeff()}),
                        std::max(largest_inertia(robot.links), robot.rotor_inertia.maxCoeff()));
  }

  /// First time derivative of eq. 10's theta_ref.
  [[nodiscard]] Vector theta_ref_dot(const LoopState& x, const loop::ReferencePoint& r,
                                     const Vector& nu1) const {
    const Vector vdot =
        robot::forward_dynamics(robot.links, x.q, x.v, robot.spring_torque(x.q, x.theta));
    const Vector feedforward = robot::first_derivative(robot::inverse_dynamics(
        robot.links, robot::jet(x.q, x.v, vdot), robot::jet(r.v_ref, r.a_ref, r.jerk_ref),
        robot::jet(r.a_ref, r.jerk_ref, r.snap_ref)));
    const Vector e1dot = x.v - r.v_ref;
    const Vector nu1dot = link.b.cwiseProduct(e1dot) - link.a.cwiseProduct(nu1);
    const Vector torque_dot =
        feedforward - link.kp.cwiseProduct(e1dot) - link.kd.cwiseProduct(nu1dot);
    return r.v_ref + torque_dot.cwiseQuotient(robot.stiffness);
  }

  double operator()(const LoopState& x, const loop::ReferencePoint& r) const {
    const Vector& nu1 = x.controller.value[1];
    const Vector& nu2 = x.controller.value[3];
    const Vector theta_ref = law.motor_reference({x.q, x.v, x.theta}, r, nu1).theta_ref;
    const Vector e1 = x.q - r.q_ref;
    const Vector e2 = x.theta - theta_ref;
    const Vector e2dot = x.thetadot - theta_ref_dot(x, r, nu1);
    const Vector e1dot = x.v - r.v_ref;
    const Vector momentum1 = robot::mass_matrix(robot.links, x.q) * e1dot;
    const Vector momentum2 = robot.rotor_inertia.cwiseProduct(e2dot);
    return 0.5 * (e1dot.dot(momentum1) + e2dot.dot(momentum2)) +
           0.5 * (weighted(link.kp, e1) + weighted(motor.kp, e2) +
                  weighted(robot.stiffness, e1 - e2)) +
           0.5 * (weighted(link.kd_by_b(), nu1) + weighted(motor.kd_by_b(), nu2)) +
           epsilon * ((e1 - nu1).dot(momentum1) + (e2 - nu2).dot(momentum2));
  }
};

LyapunovFunction kelly_flexible(const experiment::Scenario& scenario) {
  const auto robot =
      std::make_shared<const controller::law::FlexibleRobot>(controller::flexible_robot(scenario));
  const Gains gains(scenario, "");
  return {
      "½ v′M v + ½ θ̇′Jθ̇ + ½ e′[K, −K; −K, K + Kp] e + U(q) − U(q_ref) − g(q_ref)′e₁ + "
      "½ ν′Kd B⁻¹ν",
      0,
      [robot, kp = gains.kp, kd_by_b = gains.kd_by_b()](const LoopState& x,
                                                        const loop::ReferencePoint& r) {
        const Vector g = robot::gravity_torque(robot->links, r.q_ref);
        const Vector e1 = x.q - r.q_ref;
        const Vector e2 = x.theta - r.q_ref - g.cwiseQuotient(robot->stiffness);
        return robot::kinetic_energy(robot->links, x.q, x.v) +
               0.5 * weighted(robot->rotor_inertia, x.thetadot) +
               0.5 * (weighted(kp, e2) + weighted(robot->stiffness, e1 - e2)) +
               robot::potential_energy(robot->links, x.q) -
               robot::potential_energy(robot->links, r.q_ref) - g.dot(e1) +
               0.5 * weighted(kd_by_b, x.controller.value[1]);
      }};
}

}  // namespace

std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario) {
  const std::string& law = scenario.controller.law;
  if (law == controller::law::LoriaOrtegaRigid::name ||
      law == controller::law::KellyRegulation::name) {
    return rigid(scenario);
  }
  if (law == controller::law::LoriaOrtegaFlexible::name) {
    const auto flexible = std::make_shared<const Flexible>(scenario);
    return LyapunovFunction{
        "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε (e − ν)′Mė, links and motors", flexible->epsilon,
        [flexible](const LoopState& state, const loop::ReferencePoint& reference) {
          return (*flexible)(state, reference);
        }};
  }
  if (law == controller::law::KellyFlexible::name) return kelly_flexible(scenario);
  return {};
}

}  // namespace tachless::certificate
