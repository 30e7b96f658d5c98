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
    return fmt::format("no stability certificate is available for {}", law);
  }
  const auto* const file = std::get_if<reference::trajectory::MotionFile>(&scenario.reference);
  if (file != nullptr && file->motion == nullptr) {
    return fmt::format("the table {} of the reference was not loaded", file->path);
  }
  if (law != LoriaOrtegaFlexible::name && scenario.robot.flexible) {
    return fmt::format(
        "{} assumes rigid joints, but this robot's are flexible: its proof does not hold", law);
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

/// The loop in error coordinates, where it starts, and the search for weights of V.
class ErrorLoop {
 public:
  explicit ErrorLoop(const experiment::Scenario& scenario)
      : model_(error_model(scenario)),
        system_(system_of(scenario)),
        B_d_(velocity_bound(scenario)),
        q_(scenario.plant.initial.position_rad),
        initial_(initial_error(scenario)) {}

  [[nodiscard]] const ErrorSystem& system() const { return system_; }
  [[nodiscard]] const robot::Model& model() const { return model_; }
  [[nodiscard]] double B_d() const { return B_d_; }
  [[nodiscard]] double V0(const Weights& weights) const {
    return lyapunov_value(system_, weights, model_, q_, initial_);
  }
  /// Whether what is certified holds for all postures.
  [[nodiscard]] bool proved() { return fine().postures.proved; }

  /// The search is over few postures, to which those that bind are added, and then what is found is
  /// certified over many.
  std::optional<CertifiedRegion> best(Goal goal) {
    const MatrixCondition coarse{
        system_, Postures(model_, {.circle_points = 24, .bound_between = false, .samples = 12}),
        B_d_, false};
    const MatrixCondition middle =
        proved() ? MatrixCondition{fine().system, fine().postures, B_d_, false}
                 : MatrixCondition{system_, Postures(model_, {.samples = 128}), B_d_, false};
    const auto found = best_weights(coarse, middle, goal);
    if (!found) return {};
    const auto region = fine().region(found->weights);
    if (!region) return {};
    CertifiedRegion result{{found->weights, *region, fine().rate(found->weights, 0)}};
    result.V0 = V0(found->weights);
    // From V0 on, |delta| stays below sqrt(2 w V0).
    if (result.holds_initial_state()) {
      result.rate_from_start = fine().rate(found->weights, std::sqrt(2 * region->w * result.V0));
    }
    return result;
  }

 private:
  const MatrixCondition& fine() {
    if (!fine_) fine_ = {system_, Postures(model_, {.samples = 1024}), B_d_};
    return *fine_;
  }

  robot::Model model_;
  ErrorSystem system_;
  double B_d_;  ///< sup |v_ref|
  Vector q_;    ///< at the start
  VectorXd initial_;
  std::optional<MatrixCondition> fine_;
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
                                                          Effort effort, std::string& why_not,
                                                          const OnProgress& tell) {
  why_not = refusal(scenario);
  if (!why_not.empty()) return {};
  ErrorLoop loop(scenario);
  StabilityCertificate result;
  result.B_d = loop.B_d();
  result.constant = result.B_d == 0;
  const bool few = !result.constant && scenario.num_joints <= most_joints_of_certified_run;
  if (few || effort == Effort::full) {
    tell("certified region: fastest rate");
    result.proved = loop.proved();
    result.fastest = loop.best(Goal::rate);
  }
  if (!result.constant && (result.proved || effort == Effort::full)) {
    tell("certified region: largest ball");
    result.largest = loop.best(Goal::ball);
  }
  const auto& choice = result.largest ? result.largest : result.fastest;
  result.provisos = provisos(scenario, choice ? &choice->region : nullptr);
  return result;
}

std::optional<Region> largest_region(const experiment::Scenario& scenario) {
  if (!refusal(scenario).empty()) return {};
  ErrorLoop loop(scenario);
  if (loop.B_d() == 0) return {};
  const auto found = loop.best(Goal::ball);
  return found ? std::optional(found->region) : std::nullopt;
}

std::optional<PaperConditions> paper_conditions(const experiment::Scenario& scenario,
                                                std::string& why_not) {
  why_not = refusal(scenario);
  if (!why_not.empty()) return {};
  const ErrorLoop loop(scenario);
  const RobotConstants constants = robot_constants(loop.model());
  return PaperConditions{constants, printed_conditions(loop.system(), constants, loop.B_d())};
}

std::optional<CertifiedRun> certified_run(const experiment::Scenario& scenario) {
  std::string why_not;
  const auto all = stability_certificate(scenario, Effort::quick, why_not);
  if (!all) return {};
  if (all->constant) {
    return CertifiedRun{{}, ErrorLoop(scenario).V0({}), infinity, 0, true, all->provisos};
  }
  std::optional<CertifiedRun> best;
  for (const auto& found : {all->fastest, all->largest}) {
    if (!found || (best && found->rate_from_start <= best->rate)) continue;
    best = CertifiedRun{found->weights,         found->V0,   found->region.level,
                        found->rate_from_start, all->proved, all->provisos};
  }
  return best;
}

}  // namespace tachless::certificate
