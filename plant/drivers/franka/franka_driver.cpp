#include "plant/drivers/franka/franka_driver.h"

#include <fmt/format.h>
#include <sched.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <thread>
#include <utility>

#include "base/failure.h"
#include "base/logging.h"
#include "base/text.h"
#include "scenario/driver_settings.h"

namespace tachless::fci {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using base::Failure;
using franka::RobotMode;
using Numbers7 = std::array<double, 7>;

// The arm takes a change of 1 N m in a tick, and tells in single precision what it took: up to
// 87 N m to 4e-6 N m.
constexpr double most_change = 0.999;
// A state of the socket's queue is old after this.
constexpr auto longest_fresh = 50ms;

Vector vector_of(const Numbers7& numbers) {
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(7));
}

template <std::size_t n>
std::array<double, n> array_of(const std::vector<double>& numbers) {
  std::array<double, n> array{};
  std::copy_n(numbers.begin(), n, array.begin());
  return array;
}

std::optional<base::Refusal> refuse_unless(bool right, const char* key, std::size_t number,
                                           std::size_t allowed) {
  if (right) return {};
  return base::Refusal{key, fmt::format("{} numbers; allowed: {}", number, allowed)};
}

/// Priority of the calling thread, restored at the end of the scope.
class KeptPriority {
 public:
  KeptPriority() { ::sched_getparam(0, &parameters_); }
  ~KeptPriority() { ::sched_setscheduler(0, policy_, &parameters_); }
  KeptPriority(const KeptPriority&) = delete;
  KeptPriority& operator=(const KeptPriority&) = delete;

 private:
  int policy_ = ::sched_getscheduler(0);
  sched_param parameters_{};
};

Failure refused(const std::string& address, std::string_view problem) {
  return base::bad_usage("the arm at {} (plant.driver.address): {}", address, problem);
}

std::shared_ptr<franka::Robot> connected(const std::string& address) {
  const KeptPriority kept;
  try {
    // kEnforce would demand a PREEMPT_RT kernel. tachless says itself what rights are missing.
    return std::make_shared<franka::Robot>(address, franka::RealtimeConfig::kIgnore);
  } catch (const franka::IncompatibleVersionException& error) {
    throw refused(address,
                  fmt::format("it speaks version {} of its interface, this libfranka version {}; "
                              "versions 7, 8, 9 and 10 are systems from 5.5.0, 5.7.0, 5.7.2 and "
                              "5.9.0 on: update the arm's system, or take the libfranka of its "
                              "version",
                              error.server_version, error.library_version));
  } catch (const franka::NetworkException& error) {
    throw refused(address, fmt::format("{}: activate FCI in Desk, see the cable at the control's "
                                       "LAN port, and ping the address",
                                       base::one_line(error.what())));
  } catch (const std::exception& error) {  // some are no franka::Exception
    throw refused(address, base::one_line(error.what()));
  }
}

/// Keeps a control and its robot until the process ends, and does not destroy them then either.
void keep(std::shared_ptr<franka::Robot> robot,
          std::unique_ptr<franka::ActiveControlBase> control) {
  using Kept =
      std::pair<std::shared_ptr<franka::Robot>, std::unique_ptr<franka::ActiveControlBase>>;
  static auto& kept = *new std::vector<Kept>;
  kept.emplace_back(std::move(robot), std::move(control));
}

/// Sends StopMove from a thread of its own, because libfranka waits for the answer without an end.
void send_stop(const std::shared_ptr<franka::Robot>& robot) {
  sched_param parameters{};
  ::sched_getparam(0, &parameters);
  const int policy = ::sched_getscheduler(0);
  std::thread([robot, parameters, policy] {
    // With a lower priority the request may come after 20 ms, when the arm has a reflex.
    ::sched_setscheduler(0, policy, &parameters);
    try {
      robot->stop();
    } catch (const std::exception&) {  // the states tell whether the arm stopped
    }
  }).detach();
}

}  // namespace

std::optional<base::Refusal> Load::refusal() const {
  if (auto refusal = refuse_unless(center_m.size() == 3, "center_m", center_m.size(), 3)) {
    return refusal;
  }
  return refuse_unless(inertia_kgm2.size() == 3, "inertia_kgm2", inertia_kgm2.size(), 3);
}

std::optional<base::Refusal> Settings::refusal() const {
  if (auto refusal = refuse_unless(collision_torque_Nm.size() == 7, "collision_torque_Nm",
                                   collision_torque_Nm.size(), 7)) {
    return refusal;
  }
  if (auto refusal = refuse_unless(collision_force_N.size() == 3, "collision_force_N",
                                   collision_force_N.size(), 3)) {
    return refusal;
  }
  return refuse_unless(collision_moment_Nm.size() == 3, "collision_moment_Nm",
                       collision_moment_Nm.size(), 3);
}

std::string told_urdf(const std::string& address) {
  const std::shared_ptr<franka::Robot> robot = connected(address);
  try {
    return robot->getRobotModel();
  } catch (const std::exception& error) {
    throw refused(address, base::one_line(error.what()));
  }
}

FrankaDriver::FrankaDriver(const scenario::Scenario& scenario)
    : settings_(scenario::driver_settings<Settings>(scenario)) {
  if (scenario.num_joints != 7) {
    throw scenario.complaint("robot.urdf", "{} joints; a Franka arm has 7", scenario.num_joints);
  }
  robot_ = connected(settings_.address);
  try {
    update();
    if (now_.robot_mode == RobotMode::kReflex && settings_.recover) recover();
    require_idle();
    compare_limits(scenario);
  } catch (const franka::Exception& error) {
    throw refused(settings_.address, base::one_line(error.what()));
  }
  base::log_detail("the arm adds the gravity of an end effector of {} kg, which Desk states",
                   base::shortest(now_.m_ee));
}

FrankaDriver::~FrankaDriver() {
  if (control_ != nullptr) keep(std::move(robot_), std::move(control_));
}

void FrankaDriver::recover() {
  robot_->automaticErrorRecovery();
  const auto end = Clock::now() + 2s;
  do {
    update();
  } while (now_.robot_mode != RobotMode::kIdle && Clock::now() < end);
  if (now_.robot_mode == RobotMode::kIdle) {
    base::log_warning("the arm was in a reflex and has recovered (plant.driver.recover)");
  }
}

void FrankaDriver::require_idle() const {
  const char* problem = "it moves, or recovers: wait until it rests";
  switch (now_.robot_mode) {
    case RobotMode::kIdle:
      return;
    case RobotMode::kReflex:
      problem =
          "a reflex has stopped it: recover it in Desk, or type --set plant.driver.recover=true";
      break;
    case RobotMode::kUserStopped:
      problem = "its user stop is pressed: release it";
      break;
    case RobotMode::kGuiding:
      problem = "it is guided by hand: let it go, and end the guiding mode";
      break;
    case RobotMode::kOther:
      problem = "its brakes are closed, or Desk uses it: open them in Desk";
      break;
    default:
      break;
  }
  throw refused(settings_.address, problem);
}

void FrankaDriver::compare_limits(const scenario::Scenario& scenario) const {
  robot::Model arm;
  try {
    arm = robot::model_from_urdf(robot_->getRobotModel(), "the arm's model");
  } catch (const std::invalid_argument& problem) {
    return base::log_detail("the limits of the arm's own model were not compared: {}",
                            problem.what());
  }
  const robot::Model& ours = *scenario.model;
  const Eigen::Index n = std::min(ours.num_joints, arm.num_joints);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto warn = [&](const char* limit, double given, double allowed) {
      base::log_warning(
          "robot.urdf has the {} {:.6g} for {}, the arm's own model {:.6g}: take the arm's", limit,
          given, ours.joint_names[static_cast<std::size_t>(i)], allowed);
    };
    constexpr double rounding = 1e-4;  // of the numbers in such files
    constexpr double end_rad = 0.1;
    if (ours.lower[i] < arm.lower[i] - rounding) warn("lower limit", ours.lower[i], arm.lower[i]);
    if (ours.upper[i] > arm.upper[i] + rounding) warn("upper limit", ours.upper[i], arm.upper[i]);
    if (ours.velocity_limit[i] > arm.velocity_limit[i] + rounding) {
      warn("speed limit", ours.velocity_limit[i], arm.velocity_limit[i]);
    }
    const double near_end = robot::speed_limit(ours, i, ours.upper[i] - end_rad, 1);
    const double allowed = robot::speed_limit(arm, i, arm.upper[i] - end_rad, 1);
    if (near_end > allowed + rounding) {
      warn("speed limit (position_based_velocity_limits, 0.1 rad before the end of the range)",
           near_end, allowed);
    }
  }
}

void FrankaDriver::start() {
  const KeptPriority kept;
  try {
    update();
    require_idle();
    const auto torques = array_of<7>(settings_.collision_torque_Nm);
    std::array<double, 6> forces{};
    std::ranges::copy(settings_.collision_force_N, forces.begin());
    std::ranges::copy(settings_.collision_moment_Nm, forces.begin() + 3);
    robot_->setCollisionBehavior(torques, torques, torques, torques, forces, forces, forces,
                                 forces);
    set_load();
    control_ = robot_->startTorqueControl();
  } catch (const franka::Exception& error) {
    throw refused(settings_.address, base::one_line(error.what()));
  }
  running_ = true;
  read_at_ = Clock::now();
}

void FrankaDriver::set_load() {
  const auto& inertia = settings_.load.inertia_kgm2;
  robot_->setLoad(settings_.load.mass_kg, array_of<3>(settings_.load.center_m),
                  {inertia[0], 0, 0, 0, inertia[1], 0, 0, 0, inertia[2]});
  constexpr double rounding = 1e-5;  // single precision, up to 10 kg
  const auto end = Clock::now() + 200ms;
  do {
    update();
    if (std::abs(now_.m_load - settings_.load.mass_kg) < rounding) return;
  } while (Clock::now() < end);
  throw refused(settings_.address,
                fmt::format("it was told of a load of {} kg and has {} kg: set the load in Desk, "
                            "and plant.driver.load.mass_kg to the same",
                            base::shortest(settings_.load.mass_kg), base::shortest(now_.m_load)));
}

void FrankaDriver::stop() {
  if (lost_) {
    throw plant::StopsByItself(
        "without a connection the arm stops by a reflex, at the latest when 20 torques in a row "
        "are missing");
  }
  if (!std::exchange(running_, false)) return;
  send_stop(robot_);
  try {
    // No torque any more: whether the request arrives or not, the arm stops within 21 ms.
    const auto end = Clock::now() + 200ms;
    for (update(); now_.robot_mode == RobotMode::kMove; update()) {
      if (Clock::now() < end) continue;
      running_ = true;
      throw Failure(ExitCode::protective_stop,
                    std::string_view("the arm still moves 200 ms after its last torque"));
    }
  } catch (const franka::Exception& error) {
    throw plant::StopsByItself(
        fmt::format("the arm's states end ({}), and without torques a reflex stops the arm",
                    base::one_line(error.what())));
  }
  if (now_.robot_mode == RobotMode::kReflex) {
    base::log_warning("the arm did not stop by the request: {}", reason());
  }
}

plant::ArmState FrankaDriver::exchange(const Vector& tau) {
  if (lost_) {  // `rest` is called on after the failure
    std::this_thread::sleep_for(1ms);
    plant::ArmState none;
    none.missing = true;
    return none;
  }
  guarded([&] {
    if (running_ && tau.size() == 7) send(tau);
    update();
  });
  if (running_) require_moving();
  plant::ArmState state;
  state.q = vector_of(now_.q);
  state.v = vector_of(now_.dq);
  state.accepted = vector_of(now_.tau_J_d);
  state.measured = vector_of(now_.tau_J);
  state.time_s = now_.time.toSec();
  return state;
}

void FrankaDriver::send(const Vector& tau) {
  const Vector accepted = vector_of(now_.tau_J_d);
  const Vector limited = accepted + (tau - accepted).cwiseMax(-most_change).cwiseMin(most_change);
  limited_ += (limited - tau).isZero(1e-12) ? 0 : 1;
  Numbers7 torques{};
  Vector::Map(torques.data(), 7) = limited;
  control_->writeOnce(franka::Torques(torques));
  answers_.add(Clock::now() - read_at_);
}

void FrankaDriver::update() {
  if (Clock::now() - read_at_ > longest_fresh) robot_->readOnce();
  now_ = robot_->readOnce();
  read_at_ = Clock::now();
}

void FrankaDriver::require_moving() {
  constexpr int longest_start = 20;  // states
  if (now_.robot_mode == RobotMode::kIdle && !moved_ && ++unmoved_ <= longest_start) return;
  if (now_.robot_mode != RobotMode::kMove) {
    running_ = false;  // the arm has stopped itself
    throw Failure(ExitCode::protective_stop, "the arm: {}", reason());
  }
  moved_ = true;
  ++ticks_;
  last_rate_ = now_.control_command_success_rate;
  rate_sum_ += last_rate_;
  lowest_rate_ = std::min(lowest_rate_, last_rate_);
}

std::string FrankaDriver::reason() const {
  if (now_.robot_mode == RobotMode::kUserStopped) {
    return "its user stop was pressed; release it for the next run";
  }
  const franka::Errors& errors = now_.last_motion_errors;
  const std::pair<bool, std::string> causes[] = {
      {errors.joint_reflex || errors.cartesian_reflex,
       "a contact, a load that Desk and plant.driver.load do not state, or thresholds too low "
       "(plant.driver.collision_torque_Nm)"},
      {errors.communication_constraints_violation,
       fmt::format("more than 20 torques in a row did not come in time, of the 100 before {:.0f} % "
                   "came: see the network, and type tachless doctor",
                   100 * last_rate_)},
      {errors.controller_torque_discontinuity, "a torque changed by more than 1 N m in a tick"},
      {errors.joint_velocity_violation || errors.cartesian_velocity_violation,
       "faster than the arm's limit, which decreases toward the ends of a joint's range: slow the "
       "reference"},
      {errors.joint_position_limits_violation, "a joint at the end of its range"},
      {errors.self_collision_avoidance_violation, "the arm came too near to itself"},
      {errors.power_limit_violation, "more power than the arm gives: slow the reference"},
      {errors.tau_j_range_violation,
       "a torque beyond its sensor's range, gravity included: set plant.drive.torque_limit_Nm to "
       "the URDF's effort or less"}};
  std::string text = fmt::format("a reflex stopped it: {}", std::string(errors));
  for (const auto& [is, cause] : causes) {
    if (is) text += " (" + cause + ")";
  }
  return text + "; recover it in Desk or by plant.driver.recover";
}

template <class Call>
void FrankaDriver::guarded(const Call& call) {
  try {
    call();
  } catch (const franka::NetworkException& error) {
    lost_ = std::exchange(running_, false);
    throw Failure(ExitCode::protective_stop, "the connection to the arm at {} is lost: {}",
                  settings_.address, base::one_line(error.what()));
  } catch (const franka::Exception& error) {
    throw Failure(ExitCode::protective_stop, "the arm: {}", base::one_line(error.what()));
  }
}

std::vector<plant::DriverFigure> FrankaDriver::figures() const {
  std::vector<plant::DriverFigure> figures = {{"end_effector_kg", now_.m_ee},
                                              {"load_kg", now_.m_load}};
  if (ticks_ == 0) return figures;
  const double mean = rate_sum_ / static_cast<double>(ticks_);
  figures.insert(figures.end(), {{"success_rate_mean", mean},
                                 {"success_rate_lowest", lowest_rate_},
                                 {"torques_limited", static_cast<double>(limited_)},
                                 {"answer_median_us", answers_.percentile_us(0.5)},
                                 {"answer_99_percent_us", answers_.percentile_us(0.99)},
                                 {"answer_max_us", answers_.max_us()}});
  return figures;
}

}  // namespace tachless::fci
