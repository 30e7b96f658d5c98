#include "plant/guarded_robot.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <variant>

#include "base/child.h"
#include "base/logging.h"
#include "base/text.h"
#include "base/users_code.h"
#include "plant/mujoco/mujoco.h"
#include "plant/plant_model.h"
#include "plant/spec.h"
#include "scenario/drive_loop.h"

namespace tachless::plant {
namespace {

using base::Clock;
using base::ExitCode;
using base::Failure;

constexpr const char* driver_name = "the driver";

/// Returns the limits of the following error; empty: none.
Vector following_error(const Spec& spec, const RobotDriver* driver, int num_joints) {
  if (spec.following_error_rad) return *spec.following_error_rad;
  return driver == nullptr ? Vector() : default_following_error(num_joints);
}

/// Returns the drives of a real robot. Unless the scenario gives plant.initial.torque, they start
/// with the torque that holds the robot, since its brakes open under that torque.
Drive real_drive(const scenario::Scenario& scenario) {
  Spec plant = scenario.plant;
  if (!scenario.gives("plant.initial.torque")) plant.initial.torque = InitialTorque::hold;
  plant.drive.command_age_jitter_ticks = 0;
  return make_drive(plant, scenario.loop, unloaded_model(scenario));
}

/// Returns ideal encoders: a real robot's readings have noise, latency and resolution already.
Encoder ideal_encoder(const robot::Model& model) {
  return {{}, Vector::Zero(model.num_joints), model};
}

/// Refuses keys of mechanics that a simulator has itself: they would have no effect. The keys of
/// the emulator's own computation (plant.mechanics, plant.integrator) state no property of a robot.
void require_simulable(const scenario::Scenario& scenario) {
  for (const char* key :
       {"robot.joints.flexible", "plant.payload", "plant.disturbances",
        "plant.drive.viscous_friction_Nms_per_rad", "plant.drive.coulomb_friction_Nm",
        "plant.drive.static_friction_Nm", "plant.drive.stribeck_velocity_rad_per_s",
        "plant.drive.friction_rise_Nm", "plant.drive.friction_rise_velocity_rad_per_s",
        "plant.drive.load_friction", "plant.drive.current_loop_hz", "plant.drive.torque_scale",
        "plant.drive.torque_offset_Nm"}) {
    if (!scenario.gives(key)) continue;
    throw scenario.complaint(
        key,
        "given, but a simulator has its own mechanics; remove the key and give "
        "the simulator the same");
  }
}

/// Returns the simulator of plant.mujoco; null without the key.
std::unique_ptr<Simulator> mujoco(const scenario::Scenario& scenario, const robot::Model& model) {
  if (scenario.plant.mujoco.model.empty()) return nullptr;
  require_simulable(scenario);
  return mujoco_simulator(scenario, model);
}

std::unique_ptr<RobotDriver> emulated_robot(const scenario::Scenario& scenario,
                                            const robot::Model& model, Simulator* simulator) {
  const Motors& motors = scenario.robot.flexible;
  if (simulator == nullptr) {
    return std::make_unique<EmulatedRobot>(scenario.plant, motors, scenario.loop.period_s, model);
  }
  require_simulable(scenario);
  return std::make_unique<EmulatedRobot>(scenario.plant, motors, model, *simulator);
}

/// Returns the emulated robot with the loop of its drives, if there is one.
std::unique_ptr<RobotDriver> emulator(const scenario::Scenario& scenario, const robot::Model& model,
                                      Simulator* simulator) {
  auto robot = emulated_robot(scenario, model, simulator);
  const auto loop = scenario::drive_loop(scenario);
  if (!loop) return robot;
  return std::make_unique<EmulatedDriveLoop>(
      std::move(robot), *loop, scenario::drive_count(scenario, *loop, model),
      scenario.plant.drive.torque_limit_Nm.value_or(Vector()));
}

}  // namespace

bool all_finite(const ArmState& state) {
  return state.q.allFinite() && state.v.allFinite() && state.theta.allFinite() &&
         state.thetadot.allFinite() && state.accepted.allFinite() && state.measured.allFinite();
}

Failure not_finite(std::int64_t tick) {
  return {ExitCode::protective_stop,
          fmt::format("the plant's state at tick {} is not finite: the loop is unstable; shorten "
                      "loop.period_s or soften the gains",
                      tick)};
}

GuardedRobot::GuardedRobot(const scenario::Scenario& scenario, RobotDriver* driver,
                           Simulator* simulator)
    : scenario_(scenario),
      model_(plant_model(scenario)),
      mujoco_(driver == nullptr && simulator == nullptr ? mujoco(scenario, model_) : nullptr),
      emulator_(driver == nullptr
                    ? emulator(scenario, model_, simulator == nullptr ? mujoco_.get() : simulator)
                    : nullptr),
      driver_(driver == nullptr ? *emulator_ : *driver),
      drive_(driver == nullptr ? make_drive(scenario.plant, scenario.loop, model_)
                               : real_drive(scenario)),
      encoder_(emulated() ? Encoder(scenario.plant.encoder,
                                    scenario::encoder_count(scenario, model_), model_)
                          : ideal_encoder(model_)),
      guard_(model_, scenario.robot.urdf_path,
             following_error(scenario.plant, driver, model_.num_joints),
             scenario.plant.speed_limit_rad_per_s.value_or(Vector())),
      drive_loop_(scenario::drive_loop(scenario)),
      speed_(Vector::Zero(model_.num_joints)),
      meter_(model_.num_joints),
      past_(emulated() ? scenario.plant.encoder.latency_ticks + 1 : 1) {
  const auto& limit = scenario.plant.drive.torque_limit_Nm;
  if (driver != nullptr && (!limit || !limit->allFinite())) {
    throw scenario.complaint("plant.drive.torque_limit_Nm",
                             "no limit; a real robot needs one for each joint");
  }
  if (driver != nullptr && scenario.robot.compensates.adds_torque()) own_torque_.emplace(scenario);
  const Spec& spec = scenario.plant;
  if (const std::string_view key = key_without_torques(spec); driver == nullptr && !key.empty()) {
    throw scenario.complaint(std::string(key),
                             "given, but the robot is emulated; allowed: with a driver (--plant)");
  }
  if (spec.zero_torque && (!scenario.robot.compensates.gravity || drive_loop_)) {
    throw scenario.complaint("plant.zero_torque",
                             "true, but the arm would fall; allowed: with robot.compensates: "
                             "{gravity: true} and without plant.drive.loop");
  }
  stopped_ = spec.dry_run;
  if (drive_loop_) {
    follower_ = dynamic_cast<DriveLoopDriver*>(&driver_);
    if (follower_ == nullptr) {
      throw scenario.complaint("plant.drive.loop",
                               "given, but this driver sends the drives torques alone; allowed: a "
                               "driver with plant::DriveLoopDriver::follow");
    }
  }
  if (guard_.watches_following() || drive_loop_) {
    trajectory_ = reference::make_trajectory(scenario_);
  }
  base::log_detail(driver != nullptr ? "mechanics: the driver's robot"
                   : simulator != nullptr || mujoco_ != nullptr
                       ? "mechanics: the simulator's"
                       : fmt::format("mechanics {}, integrated with accuracy {}",
                                     base::name_of(spec.mechanics),
                                     base::shortest(spec.integrator.accuracy)));
}

void GuardedRobot::feed(std::string_view measurement) {
  if (!driver_.measures_velocity() && messages::measures_velocity(measurement)) {
    throw scenario_.complaint(
        "controller.law",
        fmt::format(
            "{} measures velocity, this robot does not; take a law that is fed with positions",
            scenario_.controller.law));
  }
  const auto empty = messages::measurement_of(measurement);
  if (!empty) {
    throw Failure(ExitCode::protocol_violated,
                  "the controller asks for the measurement '{}'; the plant has {}", measurement,
                  base::joined(messages::measurement_suffixes));
  }
  measurement_ = *empty;
  scenario::require_encoders(scenario_, measurement);
}

void GuardedRobot::start() {
  if (!emulated()) {
    read(-1);
    if (!scenario_.plant.dry_run) require_start();
    if (is_clock()) require_period();
  }
  if (scenario_.plant.dry_run) return;
  started_ = true;
  if (!emulated()) base::give_notice(base::Notice::robot_starts);
  base::call_users(driver_name, [&] { driver_.start(); });
}

void GuardedRobot::require_start() const {
  const Vector begin = initial_state(scenario_.plant, scenario_.robot.flexible, model_).q;
  for (Eigen::Index i = 0; i < begin.size(); ++i) {
    if (std::abs(state_.q[i] - begin[i]) <= start_tolerance) continue;
    throw scenario_.complaint(
        "plant.initial.position_rad",
        "{:.6g} for {}, which is at {:.6g}; move the robot to within {:.6g} of where the scenario "
        "begins (run --ramp), or begin where it is",
        begin[i], robot::joint_labels(model_).joint(static_cast<std::size_t>(i)), state_.q[i],
        start_tolerance);
  }
}

void GuardedRobot::require_period() {
  std::array<double, 11> ticks{};
  for (double& each : ticks) {
    const double before_s = state_.time_s;
    each = read(-1).time_s - before_s;
    if (!std::isfinite(each)) return;
  }
  std::ranges::sort(ticks);  // some may have been missed
  const double period_s = scenario_.loop.period_s, actual_s = ticks[ticks.size() / 2];
  if (std::abs(actual_s - period_s) < 0.2 * period_s) return;
  throw scenario_.complaint("loop.period_s",
                            "{} s, but the arm's ticks are {:.3g} s apart; set one of the two",
                            base::shortest(period_s), actual_s);
}

ArmState GuardedRobot::ask_driver(std::int64_t tick) {
  if (emulated()) return driver_.read();
  for (int missed = 0; missed <= scenario_.loop.max_missed; ++missed) {
    ArmState state = base::call_users(driver_name, [&] { return driver_.read(); });
    if (!state.missing || tick >= 0) return state;
  }
  throw Failure(ExitCode::bad_usage,
                "the driver had no reading of the robot {} times in a row before the start; see "
                "whether the robot is on and connected",
                scenario_.loop.max_missed + 1);
}

std::int64_t GuardedRobot::own_tick(std::int64_t tick) {
  if (emulated() || !is_clock() || tick < 0) return tick;
  if (tick == 0) origin_s_ = state_.time_s;
  // Counted from the origin, so that a time with jitter does not add ticks again and again.
  const double periods = (state_.time_s - origin_s_) / scenario_.loop.period_s;
  if (!std::isfinite(periods)) return tick;
  constexpr double most = 1e12;  // the clock's rate is watched elsewhere
  return std::max<std::int64_t>(tick, std::llround(std::clamp(periods, 0.0, most)));
}

const ArmState& GuardedRobot::read(std::int64_t tick) {
  const auto asked = emulated() ? Clock::time_point() : Clock::now();
  const ArmState now = ask_driver(tick);
  tick_ = tick;
  missing_ = now.missing;
  if (missing_) return state_;
  const ArmState before = std::exchange(state_, now);
  if (!emulated()) {
    require_sound(tick);
    apply_conventions();
    if (!stopped_) require_time(before, tick);
  }
  tick_ = tick = own_tick(tick);
  if (driver_.measures_velocity()) {
    speed_ = state_.v;
  } else {
    measure_speed(asked);
  }
  if (own_torque_) {
    const Vector added = own_torque_->at(state_.q, speed_);
    drive_.set_added(added);
    if (state_.accepted.size() != 0) state_.accepted += added;
  }
  const std::int64_t newest = std::max<std::int64_t>(tick, 0);
  past_[newest] = state_;
  sensed_ = std::max<std::int64_t>(newest - past_.size() + 1, 0);
  watch_limits(tick);
  if (guard_.watches_following() && tick >= 0 && !stopped_) watch_following(tick);
  return state_;
}

const messages::AnyMeasurement& GuardedRobot::measure(std::int64_t tick) {
  std::visit(
      [&]<class M>(M& measurement) {
        measurement = encoder_.measure<M>(past_[sensed_], tick);
        if (!messages::all_finite(measurement)) throw not_finite(tick);
      },
      measurement_);
  return measurement_;
}

void GuardedRobot::require_sound(std::int64_t tick) const {
  const int num_motors = scenario_.robot.flexible ? scenario_.num_joints : 0;
  if (state_.q.size() != scenario_.num_joints || state_.v.size() != scenario_.num_joints ||
      state_.theta.size() != num_motors || state_.thetadot.size() != num_motors) {
    throw Failure(
        ExitCode::protective_stop,
        "the driver read {} positions and {} velocities of links, {} and {} of motors {}; the "
        "scenario has {} links and {} motors: give ArmState as many numbers",
        state_.q.size(), state_.v.size(), state_.theta.size(), state_.thetadot.size(), when(tick),
        scenario_.num_joints, num_motors);
  }
  for (const auto& [name, torque] :
       {std::pair{"accepted", &state_.accepted}, {"measured", &state_.measured}}) {
    if (torque->size() == 0 || torque->size() == state_.q.size()) continue;
    throw Failure(ExitCode::protective_stop,
                  "the driver read {} {} torques {}; the scenario has {} joints: give "
                  "ArmState::{} as many numbers, or none",
                  torque->size(), name, when(tick), scenario_.num_joints, name);
  }
  if (!all_finite(state_)) {
    throw Failure(ExitCode::protective_stop,
                  "the robot's driver read a number that is not finite {}; see its sensors",
                  when(tick));
  }
}

void GuardedRobot::require_time(const ArmState& before, std::int64_t tick) const {
  const bool stands = state_.time_s == before.time_s && (is_clock() || state_.q != before.q);
  const bool toggles =
      before.q.size() != 0 && std::isfinite(state_.time_s) != std::isfinite(before.time_s);
  if (!stands && !toggles && !(state_.time_s < before.time_s)) return;
  throw Failure(ExitCode::protective_stop,
                "the robot's driver gave the time {} s {}, and {} s before that: speeds cannot be "
                "watched; give each reading the robot's time when it was measured, or none",
                base::shortest(state_.time_s), when(tick), base::shortest(before.time_s));
}

void GuardedRobot::apply_conventions() {
  const scenario::RobotSpec& robot = scenario_.robot;
  for (auto* positions : {&state_.q, &state_.theta}) {
    if (positions->size() == 0) continue;
    *positions = robot.joint_signs.cwiseProduct(*positions) + robot.joint_offsets_rad;
  }
  for (auto* each : {&state_.v, &state_.thetadot, &state_.accepted, &state_.measured}) {
    if (each->size() != 0) *each = robot.joint_signs.cwiseProduct(*each);
  }
}

void GuardedRobot::measure_speed(Clock::time_point asked) {
  const auto seconds = [](Clock::time_point time) {
    return std::chrono::duration<double>(time.time_since_epoch()).count();
  };
  const bool own = std::isfinite(state_.time_s);
  meter_.add(state_.q, own ? state_.time_s : seconds(asked),
             own ? state_.time_s : seconds(Clock::now()));
  speed_ = meter_.speed();
}

double GuardedRobot::watched_speed(Eigen::Index joint) const {
  // Toward the end of a range the mean may be too old: the arm itself watches each tick.
  const bool newer =
      guard_.slows_near_ends(joint) && std::abs(state_.v[joint]) > std::abs(speed_[joint]);
  return newer ? state_.v[joint] : speed_[joint];
}

void GuardedRobot::watch_limits(std::int64_t tick) {
  const bool warns = emulated() && scenario_.plant.on_limit == OnLimit::warn;
  for (Eigen::Index i = 0; i < state_.q.size(); ++i) {
    // An emulated state that is not finite is none of these; it ends the run elsewhere.
    const bool outside = guard_.is_outside(i, state_.q[i]);
    const bool fast = guard_.is_fast(i, state_.q[i], watched_speed(i));
    const auto joint = static_cast<std::size_t>(i);
    beyond_limit_[joint] = warns && (outside || fast);
    if (stopped_ || (!outside && !fast)) continue;
    if (!warns) throw Failure(ExitCode::protective_stop, limit_text(i, outside, tick));
    if (std::exchange(warned_[joint], true)) continue;
    base::log_warning(limit_text(i, outside, tick));
  }
}

void GuardedRobot::watch_following(std::int64_t tick) {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  const Vector q_ref = trajectory_->at(time_s).q_ref;
  if (tick == 0) guard_.set_first_error(state_.q, q_ref);
  const Eigen::Index late = guard_.late_joint(state_.q, q_ref);
  if (late < 0) return;
  const auto& contact = state_.contact;
  const std::string touches =
      contact && !contact->geoms.empty()
          ? fmt::format("; contact ({}), {:.3g} N", base::printable(contact->geoms), contact->force)
          : "";
  throw Failure(ExitCode::protective_stop,
                guard_.following_text(late, std::abs(state_.q[late] - q_ref[late]), tick, touches));
}

std::string GuardedRobot::limit_text(Eigen::Index joint, bool outside, std::int64_t tick) const {
  const char* remedy = "";
  if (emulated()) {
    remedy = scenario_.plant.on_limit == OnLimit::warn
                 ? "; the run goes on (plant.on_limit: warn), further ticks are only counted"
                 : "; slow the reference or soften the gains, or continue with "
                   "plant.on_limit: warn";
  }
  return (outside ? guard_.range_text(joint, state_.q[joint], tick)
                  : guard_.speed_text(joint, state_.q[joint], watched_speed(joint), tick)) +
         remedy;
}

std::chrono::nanoseconds GuardedRobot::advance(std::int64_t tick) {
  const auto begin = Clock::now();
  if (emulated()) {
    move_emulator(tick);
  } else {
    if (stopped_) try_to_stop();
    base::call_users(driver_name, [&] { hold_or_rest(tick); });
  }
  return Clock::now() - begin;
}

void GuardedRobot::hold_or_rest(std::int64_t tick) {
  const double end_s = static_cast<double>(tick + 1) * scenario_.loop.period_s;
  if (stopped_ || withheld(scenario_.plant, tick)) return driver_.rest(end_s);
  const Vector tau = scenario_.plant.zero_torque ? Vector(Vector::Zero(model_.num_joints))
                     : emulated()                ? drive_.applied().tau
                                  : Vector(scenario_.robot.joint_signs.cwiseProduct(drive_.sent()));
  if (follower_ == nullptr) return driver_.hold(tau, end_s);
  follower_->follow(tau, set_point(tick), end_s);
}

SetPoint GuardedRobot::set_point(std::int64_t tick) const {
  // A set point is held over a tick: that of its middle has half the error.
  const double late = drive_loop_->late_ticks * drive_loop_->period_s;
  const messages::ReferencePoint at =
      trajectory_->at((static_cast<double>(tick) + 0.5) * scenario_.loop.period_s + late);
  if (emulated()) return {at.q_ref, at.v_ref};
  const scenario::RobotSpec& robot = scenario_.robot;
  return {robot.joint_signs.cwiseProduct(at.q_ref - robot.joint_offsets_rad),
          robot.joint_signs.cwiseProduct(at.v_ref)};
}

void GuardedRobot::move_emulator(std::int64_t tick) {
  try {
    hold_or_rest(tick);
  } catch (const Failure&) {
    throw;
  } catch (const std::runtime_error& problem) {
    throw Failure(ExitCode::protective_stop,
                  "the simulation failed at tick {}: {}; a loop that is unstable at this period "
                  "ends like this: shorten loop.period_s or soften the gains",
                  tick, problem.what());
  }
}

void GuardedRobot::stop() noexcept {
  if (stopped_) return;
  stopped_ = true;
  for (int i = 0; i < stop_attempts; ++i) try_to_stop();
  drive_.stop();
}

void GuardedRobot::try_to_stop() noexcept {
  if (!started_ || driver_stopped_) return;
  try {
    driver_.stop();
    driver_stopped_ = true;
    if (!emulated()) base::give_notice(base::Notice::robot_stopped);
  } catch (const StopsByItself& problem) {
    driver_stopped_ = true;
    unconfirmed_ = problem.what();
    base::give_notice(base::Notice::robot_stopped);
  } catch (...) {
    ++failed_stops_;
    try {
      stop_problem_ = base::current_failure().what();
    } catch (...) {  // no memory: the count alone
    }
  }
}

std::vector<DriverFigure> GuardedRobot::figures() const {
  if (emulated()) return {};
  return base::call_users(driver_name, [&] { return driver_.figures(); });
}

void GuardedRobot::require_stopped(const Failure* cause) const {
  if (!unconfirmed_.empty()) {
    throw Failure(cause != nullptr ? cause->code() : ExitCode::protective_stop,
                  "{}the robot's stop is not confirmed, but the robot stops by itself: {}",
                  cause != nullptr ? cause->what() + std::string("; ") : "", unconfirmed_);
  }
  if (failed_stops_ == 0) return;
  const std::string problem =
      fmt::format("the driver's stop failed, attempts: {}, {}", failed_stops_, stop_problem_);
  if (driver_stopped_) return base::log_warning("{}; the next one succeeded", problem);
  throw Failure(cause != nullptr ? cause->code() : ExitCode::protective_stop,
                "{}{}: use the emergency stop",
                cause != nullptr ? cause->what() + std::string("; ") : "", problem);
}

bool GuardedRobot::at_rest() const {
  constexpr double standstill = 1e-3;  // [rad/s; m/s]
  return !missing_ && (state_.v.array().abs() < standstill).all() &&
         (state_.thetadot.array().abs() < standstill).all();
}

}  // namespace tachless::plant
