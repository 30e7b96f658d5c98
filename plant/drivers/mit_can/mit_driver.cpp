#include "plant/drivers/mit_can/mit_driver.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <exception>
#include <thread>
#include <tuple>

#include "base/failure.h"
#include "base/text.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"
#include "scenario/drive_loop.h"
#include "scenario/driver_settings.h"

namespace tachless::mit_can {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using base::Failure;

// A frame may be lost: what is set up before the motion is asked for so often.
constexpr int attempts = 5;
constexpr auto longest_answer = 100ms;
// The joints rest when two looks in a row see no more than a count of 16 bits over 25 rad.
constexpr auto brake_period = 2ms;
constexpr int look_periods = 50, most_looks = 10;
constexpr double resting = 6e-4;          ///< [rad]
constexpr double count_tolerance = 1e-3;  ///< of a range, relative: it is a float in the drive

template <class... Args>
Failure stopped(fmt::format_string<Args...> text, Args&&... args) {
  return {ExitCode::protective_stop,
          std::string_view(fmt::format(text, std::forward<Args>(args)...))};
}

/// Returns the arm's model with the gravity that its brake carries.
robot::Model braked_model(const scenario::Scenario& scenario, double gravity_m_per_s2) {
  robot::Model model = plant::plant_model(scenario);
  const double stated = model.gravity.norm();
  if (stated > 0) model.gravity *= gravity_m_per_s2 / stated;
  return model;
}

}  // namespace

std::optional<base::Refusal> MotorSettings::refusal() const {
  const Ranges known = ranges_of(model);
  const bool all = position_max_rad && velocity_max_rad_per_s && torque_max_Nm;
  if (known.q == 0 && !all) {
    return base::Refusal{"position_max_rad",
                         "missing, or one of the two others is; allowed: the three ranges with "
                         "model damiao or robstride"};
  }
  const bool robstride = family_of(model) == Family::robstride;
  if (robstride && (id > 255 || reply_id > 255)) {
    return base::Refusal{id > 255 ? "id" : "reply_id",
                         "above 255; allowed for a RobStride: 1 to 255"};
  }
  return {};
}

Drive MotorSettings::drive() const {
  Drive drive{family_of(model), id, reply_id, ranges_of(model)};
  if (reply_id == 0) drive.reply_id = drive.family == Family::damiao ? id + 16 : 253;
  drive.ranges.q = position_max_rad.value_or(drive.ranges.q);
  drive.ranges.v = velocity_max_rad_per_s.value_or(drive.ranges.v);
  drive.ranges.tau = torque_max_Nm.value_or(drive.ranges.tau);
  return drive;
}

MitDriver::MitDriver(const scenario::Scenario& scenario)
    : scenario_(scenario),
      settings_(scenario::driver_settings<Settings>(scenario)),
      drive_loop_(scenario::drive_loop(scenario)),
      model_(braked_model(scenario, settings_.brake_gravity_m_per_s2)),
      bus_(settings_.bus, settings_.fd),
      wait_(base::nanoseconds_of(settings_.answer_wait_s > 0 ? settings_.answer_wait_s
                                                             : 0.1 * scenario.loop.period_s)) {
  if (static_cast<int>(settings_.motors.size()) != scenario.num_joints) {
    throw scenario.complaint("plant.driver.motors", "{} motors; the robot has {} joints",
                             settings_.motors.size(), scenario.num_joints);
  }
  const double longest_s = (scenario.loop.max_missed + 2) * scenario.loop.period_s;
  if (settings_.watchdog_s < longest_s) {
    throw scenario.complaint(
        "plant.driver.watchdog_s",
        "{} s; at least {:.3g} s are needed for loop.max_missed ({}) commands that are missed",
        base::shortest(settings_.watchdog_s), longest_s, scenario.loop.max_missed);
  }
  for (std::size_t i = 0; i < settings_.motors.size(); ++i) {
    Motor motor;
    motor.drive = settings_.motors[i].drive();
    motor.label =
        fmt::format("motor {} of {}", motor.drive.id, robot::joint_labels(model_).joint(i));
    motors_.push_back(std::move(motor));
  }
  require_gains();
  for (const Motor& motor : motors_) set_up(motor);
}

void MitDriver::require_gains() const {
  if (!drive_loop_) return;
  for (std::size_t i = 0; i < motors_.size(); ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    const Ranges& ranges = motors_[i].drive.ranges;
    for (const auto& [key, gain, most] : {std::tuple{"kp", drive_loop_->kp[joint], ranges.kp},
                                          std::tuple{"kd", drive_loop_->kd[joint], ranges.kd}}) {
      if (gain <= most) continue;
      throw scenario_.complaint(fmt::format("plant.drive.loop.{}", key),
                                "{} for {}; its frames hold at most {}", base::shortest(gain),
                                motors_[i].label, base::shortest(most));
    }
  }
}

MitDriver::~MitDriver() {
  try {
    if (started_) settle();
    collect(0ns);
    bool enabled = true;
    for (int attempt = 0; attempt < attempts && enabled; ++attempt) {
      for (Motor& motor : motors_) {
        motor.answered = false;
        send(disable(motor.drive));
      }
      collect(longest_answer);
      enabled = std::ranges::any_of(
          motors_, [](const Motor& motor) { return !motor.answered || motor.answer.enabled; });
    }
  } catch (const std::exception&) {
    // The bus is gone. The drives' watchdogs stop them.
  }
}

std::uint32_t MitDriver::read_back(const Motor& motor, Register which) {
  for (int attempt = 0; attempt < attempts; ++attempt) {
    bus_.send(read_register(motor.drive, which));
    const auto until = Clock::now() + longest_answer;
    while (const auto frame = bus_.receive(until)) {
      if (const auto bits = register_in(motor.drive, which, *frame)) return *bits;
    }
  }
  throw base::bad_usage(
      "{} does not answer on {} (id {}, answers on {}): see its power, cable and bit rate; type: "
      "tachless-mit-can scan {}",
      motor.label, bus_.name(), motor.drive.id, motor.drive.reply_id, bus_.name());
}

void MitDriver::set_up(const Motor& motor) {
  const bool damiao = motor.drive.family == Family::damiao;
  const auto set = [&](Register which, std::uint32_t bits, const char* what) {
    std::uint32_t got = 0;
    for (int attempt = 0; attempt < attempts; ++attempt) {
      bus_.send(write_register(motor.drive, which, bits));
      got = read_back(motor, which);
      if (got == bits) return;
    }
    throw base::bad_usage(
        "{}: its {} is {} and stays so, although {} was written; set it with the "
        "maker's tool",
        motor.label, what, got, bits);
  };
  set(Register::mode, damiao ? mit_mode_damiao : mit_mode_robstride, "mode of control");
  set(Register::watchdog, watchdog_bits(settings_.watchdog_s), "watchdog (units of 50 us)");
  if (!damiao) return;  // the others have their ranges in no register
  require_range(motor, Register::q_range, motor.drive.ranges.q);
  require_range(motor, Register::v_range, motor.drive.ranges.v);
  require_range(motor, Register::tau_range, motor.drive.ranges.tau);
}

void MitDriver::require_range(const Motor& motor, Register which, double expected) {
  const auto actual = static_cast<double>(std::bit_cast<float>(read_back(motor, which)));
  if (std::abs(actual - expected) <= count_tolerance * expected) return;
  const char* key = which == Register::q_range   ? "position_max_rad"
                    : which == Register::v_range ? "velocity_max_rad_per_s"
                                                 : "torque_max_Nm";
  throw scenario_.complaint("plant.driver.motors",
                            "{} has the range {:.6g} in its register, not {:.6g}: every number "
                            "would be wrong by that factor; set {} of it to {:.6g}",
                            motor.label, actual, expected, key, actual);
}

void MitDriver::start() {
  for (Motor& motor : motors_) {
    send(clear_fault(motor.drive));
    send(disable(motor.drive));
  }
  while (bus_.receive(Clock::now() + 2ms)) {
  }
  const auto all = [&](auto predicate) { return std::ranges::all_of(motors_, predicate); };
  for (int attempt = 0; attempt < attempts; ++attempt) {
    ask_all();
    collect(longest_answer);
    if (all([](const Motor& motor) { return motor.answered; })) break;
  }
  for (const Motor& motor : motors_) {
    if (!motor.answered) throw stopped("{} does not answer on {}", motor.label, bus_.name());
  }
  set_brake();
  for (int attempt = 0; attempt < attempts; ++attempt) {
    for (Motor& motor : motors_) {
      motor.answered = motor.answer.enabled;
      if (!motor.answered) send(enable(motor.drive));
    }
    collect(longest_answer);
    send_brake();
    collect(longest_answer);
    if (all([](const Motor& motor) { return motor.answer.enabled; })) break;
  }
  started_ = true;
  for (const Motor& motor : motors_) require_sound(motor);
  settle();
  send_brake();
}

void MitDriver::settle() {
  for (int look = 0, still = 0; look < most_looks && still < 2; ++look) {
    const Vector before = told_position();
    for (int period = 0; period < look_periods; ++period) {
      const auto next = Clock::now() + brake_period;
      send_brake();
      collect(brake_period);
      std::this_thread::sleep_until(next);
    }
    const bool rests = (told_position() - before).cwiseAbs().maxCoeff() <= resting;
    still = rests ? still + 1 : 0;
  }
}

void MitDriver::require_sound(const Motor& motor) const {
  if (motor.answer.fault != 0) {
    throw stopped("{} has a fault: {}", motor.label,
                  fault_text(motor.drive.family, motor.answer.fault));
  }
  if (started_ && !stopped_ && !motor.answer.enabled) {
    throw stopped("{} is not enabled: its drive has stopped by itself", motor.label);
  }
}

plant::ArmState MitDriver::read() {
  if (expecting_) {
    collect(wait_);
  } else {
    ask_all();
    collect(longest_answer);
  }
  expecting_ = false;
  count_silence();
  plant::ArmState state;
  const auto n = static_cast<Eigen::Index>(motors_.size());
  state.q.resize(n);
  state.v.resize(n);
  state.measured.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Motor& motor = motors_[static_cast<std::size_t>(i)];
    state.missing = state.missing || !motor.answered;
    if (motor.answered && !stopped_) require_sound(motor);
    state.q[i] = motor.answer.q;
    state.v[i] = motor.answer.v;
    state.measured[i] = motor.answer.tau;
  }
  return state;
}

void MitDriver::count_silence() {
  const auto now = Clock::now();
  std::size_t silent = 0;
  const Motor* longest = nullptr;
  // By the clock, because a late process leaves ticks out, which the loop counts as missed too.
  const auto ticks = [&](const Motor& motor) {
    return 1 + std::llround(std::chrono::duration<double>(now - *motor.silent_since).count() /
                            scenario_.loop.period_s);
  };
  for (Motor& motor : motors_) {
    ++expected_;
    motor.lost += motor.answered ? 0 : 1;
    motor.hottest = std::max(motor.hottest, motor.answer.temperature);
    if (motor.answered) {
      motor.silent_since.reset();
      continue;
    }
    if (!motor.silent_since) motor.silent_since = now;
    if (ticks(motor) <= scenario_.loop.max_missed) continue;
    ++silent;
    if (longest == nullptr || *motor.silent_since < *longest->silent_since) longest = &motor;
  }
  if (longest == nullptr || stopped_) return;
  throw stopped(
      "{} answered on {} in the last {} ticks: see {}",
      silent == motors_.size() && silent > 1 ? "no motor" : "all motors but " + longest->label,
      bus_.name(), ticks(*longest),
      silent == motors_.size() ? "the drives' power, the cable and the bit rate"
                               : "its power and its plug");
}

template <class SetpointOf>
void MitDriver::command_each(const SetpointOf& set_point) {
  for (std::size_t i = 0; i < motors_.size(); ++i) {
    Motor& motor = motors_[i];
    motor.answered = false;
    send(command(motor.drive, set_point(static_cast<Eigen::Index>(i)), motor.torque_rest));
  }
  expecting_ = true;
}

void MitDriver::hold(const Vector& tau, double /*until_s*/) {
  collect(0ns);  // what comes later must not count as an answer to this
  command_each([&](Eigen::Index i) { return Setpoint{.tau = tau[i]}; });
}

void MitDriver::follow(const Vector& tau, const plant::SetPoint& set_point, double /*until_s*/) {
  collect(0ns);  // as in `hold`
  command_each([&](Eigen::Index i) {
    return Setpoint{set_point.q[i], set_point.v[i], drive_loop_->kp[i], drive_loop_->kd[i], tau[i]};
  });
}

void MitDriver::rest(double /*until_s*/) {
  collect(0ns);  // nobody else reads the answers any more
  if (stopped_ && started_) {
    send_brake();
  } else {
    ask_all();
  }
}

void MitDriver::stop() {
  if (!stopped_) set_brake();
  stopped_ = true;
  try {
    send_brake();
  } catch (const Failure& problem) {
    throw plant::StopsByItself(fmt::format("{}; the drives' watchdog stops them after {} s",
                                           problem.what(), base::shortest(settings_.watchdog_s)));
  }
}

Vector MitDriver::told_position() const {
  Vector q(static_cast<Eigen::Index>(motors_.size()));
  for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = motors_[static_cast<std::size_t>(i)].answer.q;
  return q;
}

void MitDriver::set_brake() {
  const scenario::RobotSpec& robot = scenario_.robot;
  const Vector q = told_position();
  const Vector urdf_q = robot.joint_signs.cwiseProduct(q) + robot.joint_offsets_rad;
  const Vector gravity = robot.joint_signs.cwiseProduct(robot::gravity_torque(model_, urdf_q));
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    motors_[static_cast<std::size_t>(i)].brake = {q[i], 0, settings_.brake_kp_Nm_per_rad[i],
                                                  settings_.brake_kd_Nms_per_rad[i], gravity[i]};
  }
}

void MitDriver::send_brake() {
  command_each([&](Eigen::Index i) { return motors_[static_cast<std::size_t>(i)].brake; });
}

void MitDriver::ask_all() {
  for (Motor& motor : motors_) {
    motor.answered = false;
    send(ask(motor.drive));
  }
  expecting_ = true;
}

void MitDriver::send(const Frame& frame) { unsent_ += bus_.send(frame) ? 0 : 1; }

void MitDriver::collect(std::chrono::nanoseconds longest) {
  const auto until = Clock::now() + longest;
  const auto answered = [](const Motor& motor) { return motor.answered; };
  constexpr int most = 4096;  // a bus that babbles must not hold the loop
  for (int i = 0; i < most; ++i) {
    const bool all = std::ranges::all_of(motors_, answered);
    const auto frame = bus_.receive(all ? Clock::time_point() : until);
    if (!frame) return;
    take(*frame);
  }
}

void MitDriver::take(const Frame& frame) {
  for (Motor& motor : motors_) {
    if (const auto answer = answer_in(motor.drive, frame)) {
      motor.answer = *answer;
      motor.answered = true;
      return;
    }
  }
}

std::vector<plant::DriverFigure> MitDriver::figures() const {
  std::int64_t lost = 0;
  for (const Motor& motor : motors_) lost += motor.lost;
  std::vector<plant::DriverFigure> figures = {
      {"answers_missing", static_cast<double>(lost)},
      {"answers_missing_share",
       expected_ == 0 ? 0 : static_cast<double>(lost) / static_cast<double>(expected_)},
      {"frames_not_sent", static_cast<double>(unsent_)}};
  for (std::size_t i = 0; i < motors_.size(); ++i) {
    figures.push_back({fmt::format("motor_{}_hottest_C", motors_[i].drive.id), motors_[i].hottest});
  }
  return figures;
}

}  // namespace tachless::mit_can
