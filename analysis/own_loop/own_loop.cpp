#include "own_loop/own_loop.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/failure.h"
#include "base/text.h"
#include "controller/any_law.h"
#include "own_loop/loop_impl.h"
#include "robot/model.h"
#include "scenario/drive_loop.h"

namespace tachless::own_loop {
namespace {

/// Returns the law of the scenario. It steps over missed readings as in realtime.
controller::ScenarioLaw law_of(scenario::Scenario scenario) {
  scenario::require_no_drive_loop(scenario, "a loop of one's own sends torques alone");
  scenario.loop.mode = scenario::Mode::realtime;
  controller::ScenarioLaw law = controller::scenario_law(scenario);
  if (law->measurement() != messages::PositionMeasurement::suffix) {
    throw scenario.complaint("controller.law",
                             "{} measures {}; allowed here: a law that measures positions alone",
                             law->name(), law->measurement());
  }
  return law;
}

bool has_arm_coordinates(const scenario::RobotSpec& robot) {
  return (robot.joint_signs.array() != 1).any() || (robot.joint_offsets_rad.array() != 0).any();
}

/// Returns one entry per joint of a list; `otherwise` for an empty one.
Vector entries(const std::vector<double>& given, const Vector& otherwise, const char* name) {
  const Eigen::Index n = otherwise.size();
  if (given.empty()) return otherwise;
  if (given.size() == 1) return Vector::Constant(n, given[0]);
  if (std::ssize(given) != n) {
    throw base::bad_usage("bounds.{}: {} numbers; allowed: 1, or {}, one per joint", name,
                          given.size(), n);
  }
  return Eigen::Map<const Eigen::VectorXd>(given.data(), n);
}

Vector positive_entries(const std::vector<double>& given, int num_joints, const char* name) {
  const Vector all = entries(given, Vector::Zero(num_joints), name);
  if (!(all.array() > 0).all() || !all.allFinite()) {
    throw base::bad_usage("bounds.{}: missing, or not a number above 0; allowed: one per joint",
                          name);
  }
  return all;
}

constexpr double rounding = 1e-9;
/// Larger numbers are refused: the law's torque could overflow, and its failure would throw.
constexpr double largest = 1e12;

bool is_number(const Vector& x) { return (x.array().abs() <= largest).all(); }

}  // namespace

Numbers view(const Vector& x) { return {x.data(), static_cast<std::size_t>(x.size())}; }

Bounds::Bounds(const ReferenceBounds& given, const robot::Model& model)
    : speed(positive_entries(given.speed, model.num_joints, "speed")),
      acceleration(positive_entries(given.acceleration, model.num_joints, "acceleration")) {
  Vector low(model.num_joints), high(model.num_joints);
  for (int i = 0; i < model.num_joints; ++i) {
    std::tie(low[i], high[i]) = robot::finite_range(model, i);
  }
  lower = entries(given.lower, low, "lower");
  upper = entries(given.upper, high, "upper");
  for (int i = 0; i < model.num_joints; ++i) {
    if (lower[i] >= model.lower[i] && lower[i] <= upper[i] && upper[i] <= model.upper[i]) continue;
    throw base::bad_usage("bounds: {} from {} to {}; allowed by the URDF: {} to {}",
                          robot::joint_labels(model).joint(static_cast<std::size_t>(i)),
                          base::shortest(lower[i]), base::shortest(upper[i]),
                          base::shortest(model.lower[i]), base::shortest(model.upper[i]));
  }
}

int Bounds::beyond(const messages::ReferencePoint& reference,
                   const messages::ReferencePoint* before, double passed_s) const {
  const auto above = [](double x, double most) { return x > most + rounding * (1 + most); };
  for (Eigen::Index i = 0; i < speed.size(); ++i) {
    const double q = reference.q_ref[i], v = reference.v_ref[i];
    bool bad = q > upper[i] + rounding || q < lower[i] - rounding || above(std::abs(v), speed[i]) ||
               above(std::abs(reference.a_ref[i]), acceleration[i]);
    if (before != nullptr) {
      bad = bad || above(std::abs(q - before->q_ref[i]), speed[i] * passed_s) ||
            above(std::abs(v - before->v_ref[i]), acceleration[i] * passed_s);
    }
    if (bad) return static_cast<int>(i);
  }
  return -1;
}

Loop::Impl::Impl(LoopScenario made)
    : scenario(std::move(made.scenario)),
      has_reference(made.has_reference),
      arm_coordinates(has_arm_coordinates(scenario.robot)),
      law(law_of(scenario)),
      trajectory(reference::make_trajectory(scenario)),
      meter(scenario.num_joints) {
  const Vector zero = Vector::Zero(scenario.num_joints);
  if (scenario.robot.compensates.adds_torque()) own_torque.emplace(scenario);
  tau = law_tau = added = zero;
  reference = before = shown = {zero, zero, zero, zero, zero};
  std::get<messages::PositionMeasurement>(measured).q = zero;
}

Step Loop::Impl::shown_step(std::int64_t tick, Status status, int joint) const {
  Step step;
  step.status = status;
  step.joint = joint;
  step.tick = tick;
  step.tau = view(tau);
  step.law_tau = view(law_tau);
  step.arm_tau = view(added);
  step.position = view(std::get<messages::PositionMeasurement>(measured).q);
  step.desired = view(reference.q_ref);
  return step;
}

bool Loop::Impl::take(const Reference& given) {
  const auto n = static_cast<std::size_t>(scenario.num_joints);
  const auto fill = [&](const Numbers& from, Vector& to, bool optional) {
    if (optional && from.size() == 0) {
      to.setZero();
      return true;
    }
    if (from.size() != n) return false;
    std::copy(from.begin(), from.end(), to.begin());
    return true;
  };
  return fill(given.position, reference.q_ref, false) &&
         fill(given.velocity, reference.v_ref, false) &&
         fill(given.acceleration, reference.a_ref, false) &&
         fill(given.jerk, reference.jerk_ref, true) && fill(given.snap, reference.snap_ref, true);
}

Step Loop::Impl::step(std::int64_t tick, Numbers position, Status status, int joint) noexcept {
  if (failed) return shown_step(tick, Status::not_finite);
  if (tick <= last_tick) return shown_step(tick, Status::old_tick);
  const auto n = static_cast<std::size_t>(scenario.num_joints);
  if (position.size() != n) return shown_step(tick, Status::wrong_size);
  Vector& q = std::get<messages::PositionMeasurement>(measured).q;
  std::copy(position.begin(), position.end(), q.begin());
  if (arm_coordinates) {
    q = scenario.robot.joint_signs.cwiseProduct(q) + scenario.robot.joint_offsets_rad;
  }
  for (int i = 0; i < scenario.num_joints; ++i) {
    if (!(std::abs(q[i]) <= largest)) return shown_step(tick, Status::not_finite, i);
  }
  for (const Vector* each : {&reference.q_ref, &reference.v_ref, &reference.a_ref,
                             &reference.jerk_ref, &reference.snap_ref}) {
    if (!is_number(*each)) return shown_step(tick, Status::not_finite);
  }
  bool restarted = false;
  try {
    const controller::Outcome outcome = law->step(first_tick + tick, measured, reference);
    law_tau = outcome.command.tau;
    restarted = outcome.restarted && last_tick >= 0;
  } catch (...) {  // gains so large that the torque is not finite
    failed = true;
    return shown_step(tick, Status::not_finite);
  }
  tau = law_tau;
  if (own_torque) {
    const double time_s = static_cast<double>(tick) * scenario.loop.period_s;
    meter.add(q, time_s, time_s);
    added = own_torque->at(q, meter.speed());
    tau = law_tau - added;
  }
  if (arm_coordinates) tau = scenario.robot.joint_signs.cwiseProduct(tau);
  Step done = shown_step(tick, status, joint);
  done.skipped = tick - last_tick - 1;
  done.restarted = restarted;
  last_tick = tick;
  return done;
}

std::string Loop::Impl::joint_name(int joint) const {
  return robot::joint_labels(*scenario.model).joint(static_cast<std::size_t>(joint));
}

std::string Loop::Impl::reason(const Step& step) const {
  switch (step.status) {
    case Status::ok:
      return {};
    case Status::beyond_bounds:
      if (step.joint < 0) {
        return fmt::format(
            "the reference of tick {} has no certificate: give the constructor the "
            "bounds of your references",
            step.tick);
      }
      return fmt::format(
          "the reference of {} is beyond its bounds at tick {}: the torque is not "
          "certified; slow the reference or declare wider bounds",
          joint_name(step.joint), step.tick);
    case Status::old_tick:
      return fmt::format("tick {} is not later than the last one, {}; call reset before a new run",
                         step.tick, last_tick);
    case Status::wrong_size:
      return fmt::format(
          "tick {} has another number of positions or references than the robot's {} "
          "joints",
          step.tick, scenario.num_joints);
    case Status::no_reference:
      return fmt::format(
          "tick {} has no reference: give one to torque(), or write one in the "
          "scenario",
          step.tick);
    case Status::not_finite:
      return step.joint < 0
                 ? fmt::format(
                       "the reference or the torque of tick {} is not finite: the loop is "
                       "unstable, or the reference is no number; call reset before a new run",
                       step.tick)
                 : fmt::format("the position of {} at tick {} is not finite; see its encoder",
                               joint_name(step.joint), step.tick);
    default:
      return {};  // a guard's
  }
}

Loop::Loop(const std::string& scenario_file, const std::vector<std::string>& set)
    : impl_(std::make_shared<Impl>(read_loop_scenario(scenario_file, set))) {}
Loop::Loop(const LawSettings& law, const std::vector<std::string>& set)
    : impl_(std::make_shared<Impl>(make_loop_scenario(law, set))) {}
Loop::Loop(Loop&&) noexcept = default;
Loop& Loop::operator=(Loop&&) noexcept = default;
Loop::~Loop() = default;

Step Loop::torque(std::int64_t tick, Numbers position) noexcept {
  Impl& my = *impl_;
  if (!my.has_reference) return my.shown_step(tick, Status::no_reference);
  my.reference = my.trajectory.at(static_cast<double>(tick) * my.scenario.loop.period_s);
  return my.step(tick, position, Status::ok, -1);
}

Step Loop::torque(std::int64_t tick, Numbers position, const Reference& reference) noexcept {
  Impl& my = *impl_;
  if (!my.take(reference)) return my.shown_step(tick, Status::wrong_size);
  Status status = Status::ok;
  int joint = -1;
  if (my.bounds) {
    const double passed_s = static_cast<double>(tick - my.before_tick) * my.scenario.loop.period_s;
    joint = my.bounds->beyond(my.reference, my.before_tick < 0 ? nullptr : &my.before, passed_s);
    if (joint >= 0) status = Status::beyond_bounds;
  } else if (my.needs_bounds) {
    status = Status::beyond_bounds;
  }
  const Step step = my.step(tick, position, status, joint);
  if (step.has_torque()) {
    my.before = my.reference;
    my.before_tick = tick;
  }
  return step;
}

void Loop::reset() noexcept {
  Impl& my = *impl_;
  // After a gap of more than AnyLaw::most_ticks the law's memory begins anew.
  my.first_tick += my.last_tick + 1 + controller::AnyLaw::most_ticks;
  my.last_tick = my.before_tick = -1;
  my.failed = false;
  my.meter = plant::SpeedMeter(my.scenario.num_joints);
}

Reference Loop::planned(std::int64_t tick) noexcept {
  Impl& my = *impl_;
  if (!my.has_reference) return {};
  my.shown = my.trajectory.at(static_cast<double>(tick) * my.scenario.loop.period_s);
  return {view(my.shown.q_ref), view(my.shown.v_ref), view(my.shown.a_ref), view(my.shown.jerk_ref),
          view(my.shown.snap_ref)};
}

std::string Loop::reason(const Step& step) const { return impl_->reason(step); }

double Loop::period_s() const noexcept { return impl_->scenario.loop.period_s; }
const std::vector<std::string>& Loop::joints() const noexcept {
  return impl_->scenario.model->joint_names;
}
bool Loop::has_reference() const noexcept { return impl_->has_reference; }

}  // namespace tachless::own_loop
