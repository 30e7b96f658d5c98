#include "certificate/scenario_loop.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "controller/law/parts.h"
#include "controller/laws.h"
#include "controller/registry.h"

namespace tachless::certificate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using loop::ReferencePoint;
using robot::Vector;

/// f(part, vector) for each part of the state that a measurement holds; on rigid joints the
/// motors' are empty.
template <class Measurement, class F>
void for_each_part(Measurement& measurement, const F& f) {
  if constexpr (requires { measurement.q; }) f(Part::q, measurement.q);
  if constexpr (requires { measurement.v; }) f(Part::v, measurement.v);
  if constexpr (requires { measurement.theta; }) f(Part::theta, measurement.theta);
  if constexpr (requires { measurement.thetadot; }) f(Part::thetadot, measurement.thetadot);
}

template <class Vectors>
VectorXd packed(const Vectors& visit) {
  std::vector<double> all;
  visit([&](const Vector& x) { all.insert(all.end(), x.begin(), x.end()); });
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Index>(all.size()));
}

template <class Vectors>
void unpack(const VectorXd& from, const Vectors& visit) {
  Index begin = 0;
  visit([&](Vector& x) {
    x = from.segment(begin, x.size());
    begin += x.size();
  });
}

/// The plant's state on the reference, by part.
std::array<Vector, 4> state_on(const ReferencePoint& r, const robot::Model& model,
                               const experiment::Scenario& scenario) {
  std::array<Vector, 4> state = {r.q_ref, r.v_ref, Vector(), Vector()};
  if (const auto& drive = scenario.robot.flexible) {
    const robot::JetVector torque = torque_on(model, r);
    state[2] = r.q_ref + robot::value(torque).cwiseQuotient(drive->stiffness);
    state[3] = r.v_ref + robot::first_derivative(torque).cwiseQuotient(drive->stiffness);
  }
  return state;
}

template <class L>
LinearLaw linear_law_of(const experiment::Scenario& scenario, const ReferencePoint& reference,
                        const std::array<Vector, 4>& state) {
  using Memory = typename L::Memory;
  using Measurement = typename L::Measurement;
  const L law = controller::make_law<L>(scenario);
  Measurement nominal;
  std::vector<Part> measured;
  for_each_part(nominal, [&](Part part, Vector& x) {
    x = state[static_cast<std::size_t>(part)];
    if (x.size() > 0) measured.push_back(part);
  });
  // That of a loop under way: what a law knows only from a step before, such as the torque that it
  // commanded, is missing in the memory that it starts with.
  const Memory memory = law.step(law.start(nominal, reference), nominal, reference).memory;
  const auto memory_vector = [](const Memory& of) {
    return packed([&](const auto& f) { controller::law::for_each_vector(of, f); });
  };
  const LawStep step = [&](const VectorXd& memory_in, const VectorXd& measurement_in) {
    Memory own_memory = memory;
    unpack(memory_in, [&](const auto& f) { controller::law::for_each_vector(own_memory, f); });
    Measurement own = nominal;
    unpack(measurement_in,
           [&](const auto& f) { for_each_part(own, [&](Part /*part*/, Vector& x) { f(x); }); });
    const auto result = law.step(own_memory, own, reference);
    return std::pair<VectorXd, VectorXd>(memory_vector(result.memory), result.command.tau);
  };
  const VectorXd measurement = packed([&](const auto& f) {
    for_each_part(std::as_const(nominal), [&](Part /*part*/, const Vector& x) { f(x); });
  });
  return linearised(step, memory_vector(memory), measurement, std::move(measured));
}

/// action(std::type_identity<L>()) for the scenario's law.
template <class F>
void with_law(const experiment::Scenario& scenario, const F& action) {
  const auto look_up = [&]<class... L>(controller::LawList<L...> /*laws*/) {
    const auto take = [&]<class One>(std::type_identity<One> type) {
      if (scenario.controller.law == One::name) action(type);
    };
    (take(std::type_identity<L>{}), ...);
  };
  look_up(controller::Laws{});
}

LinearLaw linear_law(const experiment::Scenario& scenario, const ReferencePoint& reference,
                     const std::array<Vector, 4>& state) {
  LinearLaw result;
  with_law(scenario, [&]<class L>(std::type_identity<L> /*type*/) {
    if constexpr (controller::law::MadeOfVectors<typename L::Memory>) {
      result = linear_law_of<L>(scenario, reference, state);
    }
  });
  return result;
}

/// What of the law's gradient D is there because of gravity.
MatrixXd gravity_part(const LinearLaw& law, const experiment::Scenario& scenario,
                      const ReferencePoint& reference) {
  experiment::Scenario weightless = scenario;
  robot::Model model = *scenario.model;
  model.gravity.setZero();
  weightless.model = std::make_shared<const robot::Model>(model);
  return law.D - linear_law(weightless, reference, state_on(reference, model, weightless)).D;
}

void set(experiment::Scenario& scenario, const LoopSettings& settings) {
  scenario.controller.filter = settings.filter;
  scenario.loop.command_delay = settings.delay;
  scenario.loop.period_s = settings.period_s;
}

double span_of(const experiment::Scenario& scenario) {
  const auto* sine = std::get_if<reference::trajectory::Sinusoid>(&scenario.reference);
  if (sine == nullptr || sine->frequency_hz.size() == 0) return scenario.loop.duration_s;
  const double f = sine->frequency_hz[0];
  const bool common = f > 0 && (sine->frequency_hz.array() == f).all();
  return common ? std::min(1 / f, scenario.loop.duration_s) : scenario.loop.duration_s;
}

}  // namespace

LoopSettings settings_of(const experiment::Scenario& scenario) {
  // Round the loop it is the same whether the measurement or the torque is late.
  return {scenario.controller.filter,
          scenario.loop.command_delay + scenario.plant.encoder.latency_ticks,
          scenario.loop.period_s};
}

robot::Model plant_of(const experiment::Scenario& scenario) {
  robot::Model model = *scenario.model;
  if (!scenario.robot.flexible) model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  return experiment::with_payload(scenario, std::move(model));
}

robot::JetVector torque_on(const robot::Model& links, const ReferencePoint& r) {
  return controller::law::feedforward_torque(links, r);
}

ReferencePoint held_at(const Vector& q) {
  const Vector zero = Vector::Zero(q.size());
  return {q, zero, zero, zero, zero};
}

ScenarioLoop::ScenarioLoop(const experiment::Scenario& scenario)
    : scenario_(std::make_shared<const experiment::Scenario>(scenario)),
      settings_(settings_of(scenario)),
      model_(plant_of(scenario)),
      trajectory_(reference::make_trajectory(scenario)),
      span_s_(span_of(scenario)) {
  controller::scenario_law(scenario);  // refuses what it cannot work with
  constexpr int instants = 200;
  for (int k = 0; k <= instants && !moves_; ++k) {
    moves_ = !trajectory_.at(span_s_ * k / instants).v_ref.isZero(0);
  }
}

LinearPlant ScenarioLoop::plant(const ReferencePoint& reference) const {
  const MotionPoint point{reference.q_ref, reference.v_ref, reference.a_ref};
  const VectorXd& friction = scenario_->plant.drive.viscous_friction_Nms_per_rad;
  const auto& drive = scenario_->robot.flexible;
  if (!drive) return rigid_plant(model_, point, friction);
  LinearPlant plant =
      flexible_plant(model_, point, drive->stiffness, drive->rotor_inertia, drive->motor_damping);
  if (friction.size() > 0) {
    // Of the links: M^-1 K stands in the block beside.
    const Index n = plant.num_joints;
    plant.A.block(n, n, n, n) -= plant.A.block(n, 2 * n, n, n) *
                                 friction.cwiseQuotient(VectorXd(drive->stiffness)).asDiagonal();
  }
  return plant;
}

SampledLoop ScenarioLoop::at(const ReferencePoint& reference, const LoopSettings& settings) const {
  const auto law = [scenario = scenario_, settings, reference,
                    state = state_on(reference, model_, *scenario_)](double period_s) {
    experiment::Scenario at_period = *scenario;
    set(at_period, settings);
    at_period.loop.period_s = period_s;
    LinearLaw result = linear_law(at_period, reference, state);
    result.compensation = gravity_part(result, at_period, reference);
    return result;
  };
  return {plant(reference), law, settings.delay};
}

MatrixXd ScenarioLoop::map_at(double t_s) const {
  const ReferencePoint at_tick = trajectory_.at(t_s);
  const LinearLaw law = linear_law(*scenario_, at_tick, state_on(at_tick, model_, *scenario_));
  const double h = settings_.period_s;
  return cut(plant(trajectory_.at(t_s + h / 2)), law, h, settings_.delay).closed();
}

std::vector<ReferencePoint> ScenarioLoop::rests(int count) const {
  if (!moves_ || count < 2) return {held_at(trajectory_.at(0).q_ref)};
  std::vector<ReferencePoint> result;
  result.reserve(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k) {
    result.push_back(held_at(trajectory_.at(span_s_ * k / (count - 1)).q_ref));
  }
  return result;
}

}  // namespace tachless::certificate
