#include "lyapunov/law_loop.h"

#include <fmt/format.h>

#include <algorithm>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "controller/laws.h"
#include "controller/registry.h"
#include "numerics/decompositions.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {
namespace {

using controller::law::LoriaOrtegaFlexible;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Instants of the reference at which gains that follow it are looked at.
constexpr int instants_of_scheduled = 25;

VectorXd joined(std::initializer_list<Vector> parts) {
  std::vector<double> all;
  for (const Vector& part : parts) all.insert(all.end(), part.begin(), part.end());
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

LawLoop flexible_loop(const scenario::Scenario& scenario) {
  const auto& given = scenario.plant.initial;
  const messages::ReferencePoint reference = reference::make_trajectory(scenario).at(0);
  const Vector &q = given.position_rad, &v = given.velocity_rad_per_s;
  const auto law = controller::make_law<LoriaOrtegaFlexible>(scenario);
  const auto g = controller::gains_of<LoriaOrtegaFlexible::Gains>(
      scenario, controller::law_facts(LoriaOrtegaFlexible::name));
  const auto& drive = *scenario.robot.flexible;
  const Vector theta = given.motor_position_rad.value_or(
      Vector(q + robot::gravity_torque(*scenario.model, q).cwiseQuotient(drive.stiffness)));
  const Vector thetadot = given.motor_velocity_rad_per_s.value_or(Vector(Vector::Zero(q.size())));
  const messages::LinkStateMeasurement measured{q, v, theta};
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
LawLoop rigid_loop(const scenario::Scenario& scenario) {
  const L law = controller::make_law<L>(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const messages::ReferencePoint reference = trajectory.at(0);
  const messages::PositionMeasurement measured{scenario.plant.initial.position_rad};
  const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
  LawLoop result;
  result.initial = joined({signals.value[0], signals.value[1],
                           scenario.plant.initial.velocity_rad_per_s - reference.v_ref});
  bool constant = true;
  for (const double t_s : reference::Motion(scenario, trajectory).instants(instants_of_scheduled)) {
    result.systems.push_back(
        system_at(law, trajectory.at(t_s), scenario.plant.drive.viscous_friction_Nms_per_rad));
    constant = constant && result.systems.back().kp == result.systems[0].kp;
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

std::optional<LawLoop> law_loop(const scenario::Scenario& scenario) {
  std::optional<LawLoop> result;
  controller::with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*law*/) {
    if constexpr (std::is_same_v<L, LoriaOrtegaFlexible>) result = flexible_loop(scenario);
    if constexpr (requires(const L& law) { law.filter_pole(); }) result = rigid_loop<L>(scenario);
  });
  return result;
}

std::string no_certificate(const scenario::Scenario& scenario) {
  const std::string& law = scenario.controller.law;
  bool certifiable = false;
  controller::with_law(law, [&]<class L>(std::type_identity<L> /*law*/) {
    certifiable = std::is_same_v<L, LoriaOrtegaFlexible> || requires(const L& made) {
      made.filter_pole();
    };
  });
  if (!certifiable) return fmt::format("no stability certificate is available for {}", law);
  const auto* const file = std::get_if<reference::trajectory::MotionFile>(&scenario.reference);
  if (file != nullptr && file->motion == nullptr) {
    return fmt::format("the table {} of the reference was not loaded", file->path);
  }
  if (!controller::law_facts(law).needs_flexible_joints && scenario.robot.flexible) {
    return fmt::format(
        "{} assumes rigid joints, but this robot's are flexible: its proof does not hold", law);
  }
  return {};
}

robot::Model error_model(const scenario::Scenario& scenario) {
  return scenario.robot.flexible ? controller::flexible_robot(scenario).links
                                 : controller::rigid_model(scenario);
}

double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const Vector& q, const VectorXd& x) {
  return x.dot(lyapunov_matrix(system, weights, robot::mass_matrix(links, q)) * x) / 2;
}

VelocityBound velocity_bound(const scenario::Scenario& scenario) {
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const std::vector<double> instants = reference::Motion(scenario, trajectory).closely(20001);
  MatrixXd v(scenario.num_joints, static_cast<Eigen::Index>(instants.size())), jerk = v;
  double dt = 0;
  for (std::size_t k = 0; k < instants.size(); ++k) {
    const messages::ReferencePoint r = trajectory.at(instants[k]);
    v.col(static_cast<Eigen::Index>(k)) = r.v_ref;
    jerk.col(static_cast<Eigen::Index>(k)) = r.jerk_ref;
    if (k > 0) dt = std::max(dt, instants[k] - instants[k - 1]);
  }
  VectorXd most_jerk = jerk.cwiseAbs().rowwise().maxCoeff();
  VectorXd most_v = VectorXd::Constant(v.rows(), std::numeric_limits<double>::max());
  // Of sinusoids the sum of their amplitudes bounds each joint at all times.
  const auto sines = reference::sines_of(scenario.reference);
  if (!sines.empty()) most_v = most_jerk = VectorXd::Zero(v.rows());
  for (const auto& sine : sines) {
    const VectorXd w = 2 * std::numbers::pi * sine.frequency_hz;
    const VectorXd each = VectorXd(sine.amplitude_rad).cwiseAbs().cwiseProduct(w);
    most_v += each;
    most_jerk += each.cwiseProduct(w.cwiseAbs2());
  }
  // Between two instants v_ref is off its chord by at most dt^2/8 sup |jerk|, in any norm.
  const auto most = [&](const MatrixXd& norm) {
    const double size = (norm * v).colwise().norm().maxCoeff();
    const VectorXd of_joints = norm.colwise().norm();
    return size == 0
               ? 0
               : std::min(size + dt * dt / 8 * of_joints.dot(most_jerk), of_joints.dot(most_v));
  };
  const MatrixXd one = MatrixXd::Identity(v.rows(), v.rows());
  VelocityBound bound{most(one), VectorXd(v.rows()), {}};
  for (Eigen::Index i = 0; i < v.rows(); ++i) bound.each[i] = most(one.row(i));
  if (bound.speed == 0) return bound;
  const auto [values, vectors] = numerics::symmetric_eigen(v * v.transpose());
  const VectorXd axes = values.cwiseMax(1e-6 * values.maxCoeff()).cwiseSqrt();
  bound.scale = vectors * axes.asDiagonal();
  bound.scale *= most(axes.cwiseInverse().asDiagonal() * vectors.transpose());
  return bound;
}

FrictionTorques friction_torques(const scenario::Scenario& scenario, const VectorXd& v_ref) {
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

}  // namespace tachless::lyapunov
