#include "certificate/law_loop.h"

#include <initializer_list>
#include <type_traits>

#include "certificate/scenario_loop.h"
#include "controller/laws.h"
#include "controller/registry.h"
#include "reference/make_trajectory.h"
#include "robot/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::certificate {
namespace {

using controller::law::LoriaOrtegaFlexible;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using robot::Vector;

/// Instants of the reference at which gains that follow it are looked at.
constexpr int instants_of_scheduled = 24;

VectorXd joined(std::initializer_list<Vector> parts) {
  std::vector<double> all;
  for (const Vector& part : parts) all.insert(all.end(), part.begin(), part.end());
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

LawLoop flexible_loop(const experiment::Scenario& scenario) {
  const auto& given = scenario.plant.initial;
  const loop::ReferencePoint reference = reference::make_trajectory(scenario).at(0);
  const Vector &q = given.position_rad, &v = given.velocity_rad_per_s;
  const auto law = controller::make_law<LoriaOrtegaFlexible>(scenario);
  const auto g = controller::gains_of<LoriaOrtegaFlexible::Gains>(
      scenario, controller::law_facts(LoriaOrtegaFlexible::name));
  const auto& drive = *scenario.robot.flexible;
  const Vector theta = given.motor_position_rad.value_or(
      Vector(q + robot::gravity_torque(*scenario.model, q).cwiseQuotient(drive.stiffness)));
  const Vector thetadot = given.motor_velocity_rad_per_s.value_or(Vector(Vector::Zero(q.size())));
  const loop::LinkStateMeasurement measured{q, v, theta};
  const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
  const auto motor = law.motor_reference(measured, reference, signals.value[1]);
  return {{flexible_error_system(drive.stiffness, drive.rotor_inertia, {g.kp1, g.kd1, g.a1, g.b1},
                                 {g.kp2, g.kd2, g.a2, g.b2})},
          joined({signals.value[0], signals.value[2], signals.value[1], signals.value[3],
                  v - reference.v_ref, thetadot - robot::first_derivative(motor.theta_ref)}),
          {},
          {}};
}

template <class L>
LawLoop rigid_loop(const experiment::Scenario& scenario) {
  const L law = controller::make_law<L>(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const loop::ReferencePoint reference = trajectory.at(0);
  const loop::PositionMeasurement measured{scenario.plant.initial.position_rad};
  const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
  LawLoop result;
  result.initial = joined({signals.value[0], signals.value[1],
                           scenario.plant.initial.velocity_rad_per_s - reference.v_ref});
  const ScenarioLoop::Motion motion = ScenarioLoop(scenario).motion();
  const int instants = motion.end_s > motion.begin_s ? instants_of_scheduled : 1;
  bool constant = true;
  for (int k = 0; k < instants; ++k) {
    const double t_s = motion.begin_s + k * (motion.end_s - motion.begin_s) / instants;
    result.systems.push_back(
        system_at(law, trajectory.at(t_s), scenario.plant.drive.viscous_friction_Nms_per_rad));
    constant = constant && result.systems[k].kp == result.systems[0].kp;
  }
  if (constant) {
    result.systems.resize(1);
    result.systems[0].kp_dot = result.systems[0].kd_dot = {};
    result.systems[0].v_ref = {};
  }
  if constexpr (requires { law.weights(); }) {
    result.weights = law.weights();
    result.ki =
        controller::gains_of<typename L::Gains>(scenario, controller::law_facts(L::name)).ki;
  }
  return result;
}

}  // namespace

std::optional<LawLoop> law_loop(const experiment::Scenario& scenario) {
  std::optional<LawLoop> result;
  controller::with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*law*/) {
    if constexpr (std::is_same_v<L, LoriaOrtegaFlexible>) result = flexible_loop(scenario);
    if constexpr (requires(const L& law) { law.filter_pole(); }) result = rigid_loop<L>(scenario);
  });
  return result;
}

bool certifiable(std::string_view name) {
  bool result = false;
  controller::with_law(name, [&]<class L>(std::type_identity<L> /*law*/) {
    result = std::is_same_v<L, LoriaOrtegaFlexible> || requires(const L& law) {
      law.filter_pole();
    };
  });
  return result;
}

robot::Model error_model(const experiment::Scenario& scenario) {
  return scenario.robot.flexible ? controller::flexible_robot(scenario).links
                                 : controller::rigid_model(scenario);
}

double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const Vector& q, const VectorXd& x) {
  return x.dot(lyapunov_matrix(system, weights, robot::mass_matrix(links, q)) * x) / 2;
}

VelocityBound velocity_bound(const experiment::Scenario& scenario) {
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  constexpr int instants = 20000;
  const double dt = scenario.loop.duration_s / instants;
  MatrixXd v(scenario.num_joints, instants + 1), jerk = v;
  for (int k = 0; k <= instants; ++k) {
    const loop::ReferencePoint r = trajectory.at(k * dt);
    v.col(k) = r.v_ref;
    jerk.col(k) = r.jerk_ref;
  }
  // Between two instants v_ref is off its chord by at most dt^2/8 sup |jerk|, in either norm.
  const auto most = [&](const MatrixXd& norm) {
    const double size = (norm * v).colwise().norm().maxCoeff();
    return size == 0 ? 0 : size + dt * dt / 8 * (norm * jerk).colwise().norm().maxCoeff();
  };
  VelocityBound bound{
      most(MatrixXd::Identity(v.rows(), v.rows())), v.cwiseAbs().rowwise().maxCoeff(), {}};
  if (bound.speed == 0) return bound;
  const auto [values, vectors] = robot::symmetric_eigen(v * v.transpose());
  const VectorXd axes = values.cwiseMax(1e-6 * values.maxCoeff()).cwiseSqrt();
  bound.scale = vectors * axes.asDiagonal();
  bound.scale *= most(axes.cwiseInverse().asDiagonal() * vectors.transpose());
  return bound;
}

FrictionTorques friction_torques(const experiment::Scenario& scenario, const VectorXd& v_ref) {
  const auto& drive = scenario.plant.drive;
  const auto& forward = scenario.controller.friction;
  const VectorXd Fc = drive.coulomb_friction_Nm;
  const VectorXd Fs = drive.static_friction_Nm.value_or(drive.coulomb_friction_Nm);
  const VectorXd zero = VectorXd::Zero(Fc.size());
  if (v_ref.isZero(0)) return {zero, Fs};  // v = edot, and friction takes energy
  const VectorXd Ff = forward.given() ? VectorXd(forward.coulomb) : zero;
  const VectorXd D = forward.given() ? VectorXd(forward.viscous) : zero;
  const VectorXd missing = VectorXd(drive.viscous_friction_Nms_per_rad) - D;
  FrictionTorques result{missing.cwiseAbs().cwiseProduct(v_ref), zero};
  if (Ff.isZero(0)) {
    result.on_y += Fs;
  } else {
    result.on_y += Fs - Fc + (Fc - Ff).cwiseAbs();
    result.on_delta = 2 * Fc;
    result.power = 0.2785 * Fc.dot(VectorXd(forward.smoothing));
  }
  return result;
}

}  // namespace tachless::certificate
