#include "linear/scenario_loop.h"

#include <fmt/core.h>

#include <array>
#include <map>
#include <mutex>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "controller/law/parts.h"
#include "controller/registry.h"
#include "controller/stepped_law.h"
#include "linear/drive_loop.h"
#include "linear/law_answers.h"
#include "scenario/drive_loop.h"
#include "scenario/gains.h"

namespace tachless::linear {
namespace {

using controller::Gravity;
using controller::packed;
using controller::unpack;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using messages::ReferencePoint;

/// The plant's state on the reference, by part.
std::array<Vector, 4> state_on(const ReferencePoint& r, const robot::Model& model,
                               const scenario::Scenario& scenario) {
  std::array<Vector, 4> state = {r.q_ref, r.v_ref, Vector(), Vector()};
  if (const auto& drive = scenario.robot.flexible) {
    const robot::JetVector torque = controller::law::feedforward_torque(model, r);
    state[2] = r.q_ref + robot::value(torque).cwiseQuotient(drive->stiffness);
    state[3] = r.v_ref + robot::first_derivative(torque).cwiseQuotient(drive->stiffness);
  }
  return state;
}

LinearLaw linear_law(const scenario::Scenario& scenario, const ReferencePoint& reference,
                     const std::array<Vector, 4>& state) {
  const controller::SteppedLaw law = controller::stepped_law(scenario, reference, state);
  LinearLaw result = linearised(law.step, law.memory, law.measurement, law.measured);
  // Some begin with less memory than they have from a step on.
  if (law.start(law.measurement).size() != law.memory.size()) return result;
  result.start.resize(law.memory.size(), law.measurement.size());
  constexpr double by = 1e-6;
  for (Index i = 0; i < law.measurement.size(); ++i) {
    const VectorXd moved = by * VectorXd::Unit(law.measurement.size(), i);
    result.start.col(i) =
        (law.start(law.measurement + moved) - law.start(law.measurement - moved)) / (2 * by);
  }
  return result;
}

/// Returns the part of the law's gradient D that is there because of gravity.
MatrixXd gravity_part(const LinearLaw& law, const scenario::Scenario& weightless,
                      const ReferencePoint& reference) {
  const controller::SteppedLaw floating = controller::stepped_law(
      weightless, reference, state_on(reference, *weightless.model, weightless));
  const auto torque = [&](const VectorXd& none, const VectorXd& measurement) {
    return std::pair(none, floating.step(floating.memory, measurement).second);
  };
  return law.D - linearised(torque, VectorXd(0), floating.measurement, floating.measured).D;
}

/// Returns the scenario without its texts, which are long and are copied with it.
std::shared_ptr<const scenario::Scenario> without_texts(scenario::Scenario scenario) {
  scenario.text.clear();
  scenario.robot.urdf_text.clear();
  scenario.where.clear();
  return std::make_shared<const scenario::Scenario>(std::move(scenario));
}

scenario::Scenario without_weight(scenario::Scenario scenario) {
  robot::Model model = *scenario.model;
  model.gravity.setZero();
  scenario.model = std::make_shared<const robot::Model>(std::move(model));
  return scenario;
}

/// Behind the drives' torque scale and current loops, whose torques are further states then.
LinearPlant with_drives(LinearPlant arm, const plant::DriveSpec& drive) {
  arm.B *= VectorXd(drive.torque_scale).asDiagonal();
  if (!drive.current_loop_hz) return arm;
  const Index x = arm.A.rows(), n = arm.num_joints;
  const VectorXd rate = 2 * std::numbers::pi * *drive.current_loop_hz;
  LinearPlant whole{MatrixXd::Zero(x + n, x + n), MatrixXd::Zero(x + n, n), n};
  whole.A.topLeftCorner(x, x) = arm.A;
  whole.A.topRightCorner(x, n) = arm.B;
  whole.A.bottomRightCorner(n, n).diagonal() = -rate;
  whole.B.bottomRows(n).diagonal() = rate;
  return whole;
}

}  // namespace

robot::Model plant_of(const scenario::Scenario& scenario) {
  robot::Model model = *scenario.model;
  if (!scenario.robot.flexible) model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  return scenario::with_payload(scenario, std::move(model));
}

/// The law of another program; its models are kept, since an analysis needs each several times.
struct ScenarioLoop::AskedLaw {
  LawAnswers answers;
  std::string measurement;  ///< suffix
  double own_period_s = 0;  ///< the scenario's: the compensation of gravity at others is not used
  Index window = 0;
  std::map<std::pair<std::vector<double>, std::string>, LinearLaw> known;
  std::map<std::pair<double, std::string>, Index> orders;  ///< of the models at a period, by gains
  std::mutex mutex;

  LinearLaw at(double period_s, ReferencePoint reference, const std::array<Vector, 4>& state,
               const scenario::Gains& gains) {
    const std::lock_guard lock(mutex);
    reference.gains = scenario::gains_text(gains);
    std::pair key(std::vector{period_s}, reference.gains);
    for (const Vector* each : {&reference.q_ref, &reference.v_ref, &reference.a_ref}) {
      key.first.insert(key.first.end(), each->begin(), each->end());
    }
    const auto found = known.find(key);
    if (found != known.end()) return found->second;
    messages::AnyMeasurement at_rest = messages::measurement_of(measurement).value();
    const std::vector<Part> measured = controller::measure(state, messages::parts_of(at_rest));
    const VectorXd nominal = packed(messages::parts_of(at_rest));
    Gravity gravity = Gravity::of_scenario;
    const Ask ask = [&](const MatrixXd& deviations) {
      std::vector<messages::AnyMeasurement> all(static_cast<std::size_t>(deviations.cols()),
                                                at_rest);
      for (Index k = 0; k < deviations.cols(); ++k) {
        unpack(nominal + deviations.col(k), messages::parts_of(all[static_cast<std::size_t>(k)]));
      }
      const std::vector<Vector> torques = answers(period_s, gravity, all, reference);
      MatrixXd result(torques[0].size(), deviations.cols());
      for (Index k = 0; k < result.cols(); ++k)
        result.col(k) = torques[static_cast<std::size_t>(k)];
      return result;
    };
    if (window == 0) window = window_of(ask, nominal.size());
    LinearLaw law = realised(ask, nominal.size(), window, 2 * window);
    const Index states =
        orders.try_emplace({period_s, reference.gains}, law.A.rows()).first->second;
    if (states != law.A.rows()) {
      throw NoLinearModel(
          fmt::format("it has {} states at one posture and {} at another", states, law.A.rows()));
    }
    law.measured = measured;
    law.compensation = MatrixXd::Zero(law.D.rows(), law.D.cols());
    if (period_s == own_period_s) {
      gravity = Gravity::nearly_zero;
      law.compensation = law.D - at_once(ask, nominal.size());
    }
    return known[key] = law;
  }
};

ScenarioLoop::ScenarioLoop(const scenario::Scenario& scenario, const LawAnswers& answers)
    : scenario_(without_texts(scenario)),
      weightless_(without_texts(without_weight(scenario))),
      model_(plant_of(scenario)),
      drive_loop_(scenario::drive_loop(scenario)),
      trajectory_(reference::make_trajectory(scenario)),
      motion_(scenario, trajectory_) {
  if (answers) {
    asked_ = std::make_shared<AskedLaw>();
    asked_->answers = answers;
    asked_->measurement = scenario.controller.measurement;
    asked_->own_period_s = scenario.loop.period_s;
  } else {
    controller::scenario_law(scenario);  // refuses what it cannot work with
  }
  settings_ = controller::law_settings(scenario);
}

LinearPlant ScenarioLoop::plant_with(const robot::Model& model,
                                     const ReferencePoint& reference) const {
  const plant::DriveSpec& drives = scenario_->plant.drive;
  const VectorXd& friction = drives.viscous_friction_Nms_per_rad;
  const auto& drive = scenario_->robot.flexible;
  if (!drive) {
    LinearPlant arm = with_drives(rigid_plant(model, reference, friction), drives);
    return drive_loop_ ? with_drive_loop(arm, *drive_loop_, scenario_->loop.period_s) : arm;
  }
  LinearPlant plant = flexible_plant(model, reference, drive->stiffness, drive->rotor_inertia,
                                     drive->motor_damping, drive->spring_damping);
  // The friction is that of the links. M^-1 K stands in the block beside.
  const Index n = plant.num_joints;
  plant.A.block(n, n, n, n) -= plant.A.block(n, 2 * n, n, n) *
                               friction.cwiseQuotient(VectorXd(drive->stiffness)).asDiagonal();
  return with_drives(std::move(plant), drives);
}

SampledLoop ScenarioLoop::at(const ReferencePoint& reference) const {
  const auto law = [scenario = scenario_, weightless = weightless_, asked = asked_, reference,
                    state = state_on(reference, model_, *scenario_)](double period_s) {
    if (asked) return asked->at(period_s, reference, state, scenario->controller.gains);
    const auto with_gravity_part = [&](const scenario::Scenario& own,
                                       const scenario::Scenario& floating) {
      LinearLaw result = linear_law(own, reference, state);
      result.compensation = gravity_part(result, floating, reference);
      return result;
    };
    if (period_s == scenario->loop.period_s) return with_gravity_part(*scenario, *weightless);
    scenario::Scenario own = *scenario, floating = *weightless;
    own.loop.period_s = floating.loop.period_s = period_s;
    return with_gravity_part(own, floating);
  };
  return {plant(reference), law, settings_.command_delay};
}

LinearLaw ScenarioLoop::law_with(const std::map<std::string, Vector>& gains,
                                 const ReferencePoint& reference) const {
  if (asked_) {
    return asked_->at(settings_.period_s, reference, state_on(reference, model_, *scenario_),
                      gains);
  }
  scenario::Scenario own = *scenario_, floating = *weightless_;
  own.controller.gains = floating.controller.gains = gains;
  LinearLaw law = linear_law(own, reference, state_on(reference, model_, own));
  law.compensation = gravity_part(law, floating, reference);
  return law;
}

controller::SteppedLaw ScenarioLoop::stepped(const ReferencePoint& reference) const {
  return controller::stepped_law(*scenario_, reference, state_on(reference, model_, *scenario_));
}

MatrixXd ScenarioLoop::map_at(double t_s) const {
  const ReferencePoint at_tick = trajectory_.at(t_s);
  const double h = settings_.period_s;
  const auto state = state_on(at_tick, model_, *scenario_);
  const LinearLaw law = linear_law(*scenario_, at_tick, state);
  return cut(plant(trajectory_.at(t_s + h / 2)), law, h, settings_.command_delay).closed();
}

ReferencePoint ScenarioLoop::rest_at(double share) const {
  return constant_reference(trajectory_.at(motion_.at(share)).q_ref);
}

std::vector<ReferencePoint> ScenarioLoop::rest_points(int count) const {
  std::vector<ReferencePoint> result;
  for (const double t_s : motion_.instants(count)) {
    result.push_back(constant_reference(trajectory_.at(t_s).q_ref));
  }
  return result;
}

}  // namespace tachless::linear
