#include "certificate/stability_certificate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "controller/laws.h"
#include "controller/registry.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "robot/model.h"

namespace tachless::certificate {
namespace {

using controller::law::KellyRegulation;
using controller::law::LoriaOrtegaFlexible;
using controller::law::LoriaOrtegaRigid;
using Eigen::VectorXd;
using robot::Vector;

/// sup |v_ref| over the run: between two instants |v_ref| exceeds its chord by at most
/// dt^2/8 sup |jerk|.
double velocity_bound(const experiment::Scenario& scenario) {
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  constexpr int instants = 20000;
  const double dt = scenario.loop.duration_s / instants;
  double speed = 0, jerk = 0;
  for (int k = 0; k <= instants; ++k) {
    const loop::ReferencePoint r = trajectory.at(k * dt);
    speed = std::max(speed, r.v_ref.norm());
    jerk = std::max(jerk, r.jerk_ref.norm());
  }
  return speed == 0 ? 0 : speed + dt * dt / 8 * jerk;
}

VectorXd joined(std::initializer_list<Vector> parts) {
  std::vector<double> all;
  for (const Vector& part : parts) all.insert(all.end(), part.begin(), part.end());
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

/// (e, nu, edot) at t = 0.
VectorXd initial_error(const experiment::Scenario& scenario) {
  const auto& given = scenario.plant.initial;
  const loop::ReferencePoint reference = reference::make_trajectory(scenario).at(0);
  const Vector &q = given.position_rad, &v = given.velocity_rad_per_s;
  if (scenario.controller.law == LoriaOrtegaFlexible::name) {
    const auto law = controller::make_law<LoriaOrtegaFlexible>(scenario);
    const auto& stiffness = scenario.robot.flexible->stiffness;
    const Vector theta = given.motor_position_rad.value_or(
        Vector(q + robot::gravity_torque(*scenario.model, q).cwiseQuotient(stiffness)));
    const Vector thetadot = given.motor_velocity_rad_per_s.value_or(Vector(Vector::Zero(q.size())));
    const loop::LinkStateMeasurement measured{q, v, theta};
    const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
    const auto motor = law.motor_reference(measured, reference, signals.value[1]);
    return joined({signals.value[0], signals.value[2], signals.value[1], signals.value[3],
                   v - reference.v_ref, thetadot - robot::first_derivative(motor.theta_ref)});
  }
  // Of regulation too: the filter is the same.
  const auto law = controller::make_law<LoriaOrtegaRigid>(scenario);
  const loop::PositionMeasurement measured{q};
  const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
  return joined({signals.value[0], signals.value[1], v - reference.v_ref});
}

ErrorSystem system_of(const experiment::Scenario& scenario) {
  const auto& law = controller::law_facts(scenario.controller.law);
  if (law.name == LoriaOrtegaFlexible::name) {
    const auto g = controller::gains_of<LoriaOrtegaFlexible::Gains>(scenario, law);
    const auto& drive = *scenario.robot.flexible;
    return flexible_error_system(drive.stiffness, drive.rotor_inertia, {g.kp1, g.kd1, g.a1, g.b1},
                                 {g.kp2, g.kd2, g.a2, g.b2});
  }
  return rigid_error_system(controller::gains_of<FilterGains>(scenario, law));
}

std::string refusal(const experiment::Scenario& scenario) {
  const std::string& law = scenario.controller.law;
  if (law != LoriaOrtegaRigid::name && law != LoriaOrtegaFlexible::name &&
      law != KellyRegulation::name) {
    return fmt::format("{} has no certificate here", law);
  }
  const auto* const file = std::get_if<reference::trajectory::MotionFile>(&scenario.reference);
  if (file != nullptr && file->motion == nullptr) {
    return fmt::format("the table {} of the reference is not at hand", file->path);
  }
  if (law != LoriaOrtegaFlexible::name && scenario.robot.flexible) {
    return fmt::format(
        "{} takes the joints for rigid, and they are flexible: its proof does not hold", law);
  }
  return {};
}

/// @param region of the weights chosen, if any
std::vector<std::string> provisos(const experiment::Scenario& scenario, const Region* region) {
  std::vector<std::string> result;
  if (scenario.plant.payload.mass_kg > 0) {
    result.push_back(fmt::format("the payload of {:g} kg is not in it: the law does not know of it",
                                 scenario.plant.payload.mass_kg));
  }
  const auto& drive = scenario.plant.drive;
  if (!drive.viscous_friction_Nms_per_rad.isZero(0) || drive.dry_friction()) {
    result.emplace_back("the joints' friction is not in it");
  }
  if (!scenario.plant.disturbances.empty()) result.emplace_back("disturbances are not in it");
  if (scenario.believed_model) {
    result.emplace_back("the law's robot (controller.urdf) is not the plant's");
  }
  const robot::Model& model = *scenario.model;
  for (int i = 0; region != nullptr && i < model.num_joints; ++i) {
    if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) continue;
    result.push_back(
        fmt::format("{} is prismatic and its range was sampled: it holds while |e_{}| stays in "
                    "that range; from the whole level set it may reach {:g} m",
                    robot::joint_labels(model).joint(static_cast<std::size_t>(i)), i + 1,
                    region->e_reached[i]));
  }
  return result;
}

/// The loop in error coordinates, and where it starts.
struct ErrorLoop {
  const robot::Model model;
  const ErrorSystem system;
  const double B_d;  ///< sup |v_ref|
  const Vector& q;
  const VectorXd initial;

  explicit ErrorLoop(const experiment::Scenario& scenario)
      : model(error_model(scenario)),
        system(system_of(scenario)),
        B_d(velocity_bound(scenario)),
        q(scenario.plant.initial.position_rad),
        initial(initial_error(scenario)) {}

  /// Of V at the start [J].
  [[nodiscard]] double V0(const Weights& weights) const {
    return lyapunov_value(system, weights, model, q, initial);
  }

  /// To certify. @param samples where postures are sampled
  [[nodiscard]] MatrixCondition condition(int samples) const {
    return {system, Postures(model, {.samples = samples}), B_d};
  }
  /// The same over few postures, to search: no proof, what is found is proved by the other.
  [[nodiscard]] MatrixCondition coarse_condition(int samples) const {
    return {system,
            Postures(model, {.circle_points = 24, .bound_between = false, .samples = samples}), B_d,
            false};
  }
};

}  // namespace

robot::Model error_model(const experiment::Scenario& scenario) {
  return scenario.robot.flexible ? controller::flexible_robot(scenario).links
                                 : controller::rigid_model(scenario);
}

double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const Vector& q, const VectorXd& x) {
  return x.dot(lyapunov_matrix(system, weights, robot::mass_matrix(links, q)) * x) / 2;
}

std::optional<StabilityCertificate> stability_certificate(const experiment::Scenario& scenario,
                                                          const RobotConstants& constants,
                                                          std::string& why_not,
                                                          const OnProgress& tell) {
  why_not = refusal(scenario);
  if (!why_not.empty()) return {};
  const ErrorLoop loop(scenario);
  StabilityCertificate result;
  result.system = loop.system;
  result.B_d = loop.B_d;
  result.held = loop.B_d == 0;
  result.initial = loop.initial;
  result.printed = printed_conditions(loop.system, constants, loop.B_d);
  result.printed_gamma_free = printed_conditions(loop.system, constants, loop.B_d, true);
  tell("matrix condition: postures");
  const MatrixCondition coarse = loop.coarse_condition(128);
  const MatrixCondition fine = loop.condition(PostureOptions().samples);
  result.proved = fine.postures.proved;
  result.completed = ScalarCondition(loop.system, constants, fine.postures, loop.B_d).solve();
  const auto best = [&](Goal goal) {
    auto found = best_weights(coarse, fine, goal);
    if (found) found->V0 = loop.V0(found->weights);
    return found;
  };
  tell("matrix condition: fastest rate");
  result.fastest = best(Goal::rate);
  if (!result.held) {  // at a constant reference the ball has no limit: the weights would go to 0
    tell("matrix condition: largest ball");
    result.largest = best(Goal::ball);
    tell("matrix condition: one weight");
    result.one_weight = best(Goal::ball_by_one_weight);
  }
  if (result.fastest && result.largest) {
    tell("matrix condition: trade-off");
    result.trade_off = trade_off(coarse, fine, *result.fastest, *result.largest,
                                 result.proved ? std::vector<double>{0.03, 0.1, 0.3, 0.5, 0.7, 0.9}
                                               : std::vector<double>{0.03, 0.1, 0.3});
    std::erase_if(result.trade_off, [](const TradeOff& t) { return !(t.rate > 0); });
  }
  const auto& choice = result.largest ? result.largest : result.fastest;
  result.provisos = provisos(scenario, choice ? &choice->region : nullptr);
  return result;
}

std::optional<Region> region_to_compare(const experiment::Scenario& scenario) {
  if (!refusal(scenario).empty()) return {};
  const ErrorLoop loop(scenario);
  if (loop.B_d == 0) return {};
  const MatrixCondition condition = loop.coarse_condition(12);
  const auto found = best_weights(condition, condition, Goal::ball_by_one_weight);
  return found ? std::optional(found->region) : std::nullopt;
}

std::optional<CertifiedRun> certified_run(const experiment::Scenario& scenario) {
  if (!refusal(scenario).empty()) return {};
  const ErrorLoop loop(scenario);
  if (loop.B_d == 0) {
    return CertifiedRun{{}, loop.V0({}), infinity, 0, true, provisos(scenario, nullptr)};
  }
  if (loop.model.num_joints > most_joints_of_certified_run) return {};
  const MatrixCondition coarse = loop.coarse_condition(12), fine = loop.condition(128);
  const bool proved = fine.postures.proved;
  std::optional<CertifiedRun> best;
  const auto consider = [&](const std::optional<Certified>& found) {
    if (!found) return;
    const auto region = fine.region(found->weights);
    if (!region) return;
    const double V = loop.V0(found->weights);
    // From V on, |delta| stays below sqrt(2 w V).
    const double rate =
        V <= region->level ? fine.rate(found->weights, std::sqrt(2 * region->w * V)) : -1;
    if (best && rate <= best->rate) return;
    best =
        CertifiedRun{found->weights, V, region->level, rate, proved, provisos(scenario, &*region)};
  };
  // To search, the worst of the sampled postures do.
  const MatrixCondition unrefined{fine.system, fine.postures, fine.B_d, false};
  consider(best_weights(coarse, unrefined, Goal::rate));
  // With more joints that search takes long.
  if (proved) consider(best_weights(coarse, unrefined, Goal::ball));
  return best;
}

}  // namespace tachless::certificate
