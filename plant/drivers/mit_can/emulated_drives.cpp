#include "plant/drivers/mit_can/emulated_drives.h"

#include <linux/can.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <utility>

#include "base/failure.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"
#include "scenario/driver_settings.h"

namespace tachless::mit_can {
namespace {

using base::Clock;

constexpr double step_s = 2e-4;         // of the arm's integration
constexpr double classical_s = 130e-6;  // of a frame at 1 Mbit/s
constexpr double fd_s = 50e-6;          // at 1 and 5 Mbit/s
constexpr double friction = 0.5;        // of a drive without torque [N m s/rad]
constexpr double temperature_C = 31;

}  // namespace

EmulatedDrives::EmulatedDrives(const scenario::Scenario& scenario, const Trouble& trouble)
    : settings_(scenario::driver_settings<Settings>(scenario)),
      trouble_(trouble),
      model_(plant::plant_model(scenario)),
      signs_(scenario.robot.joint_signs),
      offsets_(scenario.robot.joint_offsets_rad),
      viscous_(scenario.plant.drive.viscous_friction_Nms_per_rad),
      q_(plant::initial_state(scenario.plant, scenario.robot.flexible, model_).q),
      v_(Vector::Zero(model_.num_joints)),
      frame_s_(settings_.fd ? fd_s : classical_s),
      random_(trouble.seed) {
  constexpr std::string_view prefix = "unix:";
  sockaddr_un at{};
  at.sun_family = AF_UNIX;
  if (!settings_.bus.starts_with(prefix) ||
      settings_.bus.size() - prefix.size() >= sizeof at.sun_path) {
    throw scenario.complaint("plant.driver.bus",
                             settings_.bus + "; allowed for an emulated bus: unix:PATH");
  }
  path_ = settings_.bus.substr(prefix.size());
  path_.copy(at.sun_path, path_.size());
  if (static_cast<int>(settings_.motors.size()) != model_.num_joints) {
    throw scenario.complaint("plant.driver.motors", "{} motors; allowed: {}, one per joint",
                             settings_.motors.size(), model_.num_joints);
  }
  for (const MotorSettings& motor : settings_.motors) motors_.emplace_back().drive = motor.drive();
  ::unlink(path_.c_str());
  listener_ = base::FileDescriptor(::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  if (listener_.get() < 0 ||
      ::bind(listener_.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0 ||
      ::listen(listener_.get(), 1) != 0) {
    throw base::bad_usage("bus {}: {}", settings_.bus, std::strerror(errno));
  }
}

EmulatedDrives::~EmulatedDrives() { ::unlink(path_.c_str()); }

bool EmulatedDrives::any_enabled() const {
  return std::ranges::any_of(motors_, [](const Motor& motor) { return motor.enabled; });
}

double EmulatedDrives::now_s() const { return base::seconds_of(Clock::now() - begin_); }

bool EmulatedDrives::loses() {
  ++frames_;
  const bool lost = std::uniform_real_distribution<>()(random_) < trouble_.lost_share;
  lost_ += lost ? 1 : 0;
  return lost;
}

void EmulatedDrives::serve(const std::stop_token& ends) {
  while (!ends.stop_requested()) {
    pollfd waiting{listener_.get(), POLLIN, 0};
    constexpr int patience_ms = 10;
    if (::poll(&waiting, 1, patience_ms) <= 0) continue;
    const base::FileDescriptor client(::accept(listener_.get(), nullptr, nullptr));
    if (client.get() >= 0) serve_client(client.get(), ends);
  }
}

void EmulatedDrives::serve_client(int client, const std::stop_token& ends) {
  line_.clear();
  bus_s_ = now_s();
  for (bool open = true; open && !closed_ && !ends.stop_requested();) {
    const double wait_s =
        line_.empty() ? 1e-3 : std::clamp(line_.front().at_s - now_s(), 0.0, 1e-3);
    const timespec time{0, static_cast<long>(1e9 * wait_s)};
    pollfd ready{client, POLLIN, 0};
    ::ppoll(&ready, 1, &time, nullptr);
    take_frames(client, open);
    deliver(client, open);
    move_on(now_s());
  }
  // Frames that a client has sent before its end still arrive.
  for (const Due& due : std::exchange(line_, {})) {
    if (due.command && !closed_) handle(due.frame, now_s());
  }
}

void EmulatedDrives::take_frames(int client, bool& open) {
  for (;;) {
    canfd_frame bytes{};
    const auto size = ::recv(client, &bytes, sizeof bytes, MSG_DONTWAIT);
    if (size == 0 || (size < 0 && errno != EAGAIN)) open = false;
    if (size <= 0) return;
    bus_s_ = std::max(bus_s_, now_s()) + frame_s_;
    if (loses()) continue;
    Frame frame;
    frame.extended = (bytes.can_id & CAN_EFF_FLAG) != 0;
    frame.id = bytes.can_id & (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame.length = bytes.len;
    std::copy_n(bytes.data, frame.data.size(), frame.data.begin());
    line_.push_back({bus_s_, frame, true});
  }
}

void EmulatedDrives::deliver(int client, bool& open) {
  while (!line_.empty() && line_.front().at_s <= now_s() && !closed_) {
    const Due due = line_.front();
    line_.pop_front();
    if (due.command) {
      handle(due.frame, due.at_s);
      continue;
    }
    canfd_frame bytes{};
    bytes.can_id = due.frame.id | (due.frame.extended ? CAN_EFF_FLAG : 0);
    bytes.len = due.frame.length;
    std::ranges::copy(due.frame.data, bytes.data);
    if (::send(client, &bytes, settings_.fd ? CANFD_MTU : CAN_MTU, MSG_NOSIGNAL) < 0) open = false;
  }
}

void EmulatedDrives::answer(const Frame& frame, double at_s) {
  bus_s_ = std::max(bus_s_, at_s) + frame_s_;
  if (!loses()) line_.push_back({bus_s_, frame, false});
}

void EmulatedDrives::begin_trouble(Motor& motor, std::size_t index) {
  if (static_cast<int>(index) != trouble_.motor || motor.commands < trouble_.after) return;
  motor.silent = trouble_.silent;
  closed_ = trouble_.bus_closes;
  if (trouble_.fault == 0 || motor.fault != 0) return;
  motor.fault = trouble_.fault;
  motor.enabled = false;
}

void EmulatedDrives::handle(const Frame& frame, double at_s) {
  move_on(at_s);
  for (std::size_t i = 0; i < motors_.size(); ++i) {
    Motor& motor = motors_[i];
    const auto index = static_cast<Eigen::Index>(i);
    const Drive& drive = motor.drive;
    const auto set = setpoint_in(drive, frame);
    const bool asked = frame == ask(drive);
    if (set) {
      motor.set = *set;
      motor.heard_s = at_s;
      ++motor.commands;
      begin_trouble(motor, i);
    } else if (frame == enable(drive)) {
      motor.set = {};
      motor.heard_s = at_s;
      motor.enabled = motor.fault == 0;
    } else if (frame == disable(drive)) {
      motor.enabled = false;
    } else if (frame == clear_fault(drive)) {
      if (trouble_.fault == 0 || motor.commands == 0) motor.fault = 0;
    } else if (!asked) {
      handle_register(motor, frame, at_s);
      continue;
    }
    if (motor.silent || closed_) continue;
    const double q = signs_[index] * (q_[index] - offsets_[index]), v = signs_[index] * v_[index];
    if (asked && drive.family == Family::robstride) {
      Frame position = frame;
      position.id = 17U << 24U | static_cast<std::uint32_t>(drive.id) << 8U |
                    static_cast<std::uint32_t>(drive.reply_id);
      const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(q));
      std::memcpy(&position.data[4], &bits, sizeof bits);
      answer(position, at_s);
    } else {
      answer(answer_frame(drive, {q, v, motor.applied, motor.enabled, motor.fault, temperature_C}),
             at_s);
    }
  }
}

void EmulatedDrives::handle_register(Motor& motor, const Frame& frame, double at_s) {
  const Drive& drive = motor.drive;
  const Ranges& r = drive.ranges;
  const auto written = [&](Register which) -> std::optional<std::uint32_t> {
    Frame empty = write_register(drive, which, 0), given = frame;
    std::uint32_t bits = 0;
    std::memcpy(&bits, &given.data[4], sizeof bits);
    std::fill_n(given.data.begin() + 4, 4, std::uint8_t{0});
    return given == empty ? std::optional(bits) : std::nullopt;
  };
  if (const auto bits = written(Register::mode)) motor.mode = *bits;
  if (const auto bits = written(Register::watchdog)) motor.watchdog_s = *bits / 20000.0;
  const auto range = [](double x) { return std::bit_cast<std::uint32_t>(static_cast<float>(x)); };
  const bool troubled =
      trouble_.motor >= 0 && &motor == &motors_[static_cast<std::size_t>(trouble_.motor)];
  const double tau = r.tau * (troubled ? trouble_.torque_range_scale : 1);
  const std::pair<Register, std::uint32_t> registers[] = {
      {Register::mode, motor.mode},
      {Register::watchdog, watchdog_bits(motor.watchdog_s)},
      {Register::q_range, range(r.q)},
      {Register::v_range, range(r.v)},
      {Register::tau_range, range(tau)}};
  for (const auto& [which, bits] : registers) {
    if (motor.silent || frame != read_register(drive, which)) continue;
    Frame reply = frame;
    reply.id = drive.family == Family::damiao
                   ? static_cast<std::uint32_t>(drive.reply_id)
                   : 17U << 24U | static_cast<std::uint32_t>(drive.id) << 8U |
                         static_cast<std::uint32_t>(drive.reply_id);
    std::memcpy(&reply.data[4], &bits, sizeof bits);
    return answer(reply, at_s);
  }
}

void EmulatedDrives::move_on(double until_s) {
  while (arm_s_ < until_s) {
    if (!any_enabled()) {  // somebody holds the arm
      v_.setZero();
      arm_s_ = until_s;
      return;
    }
    const double h = std::min(step_s, until_s - arm_s_);
    Vector tau(model_.num_joints);
    for (Eigen::Index i = 0; i < tau.size(); ++i) {
      Motor& motor = motors_[static_cast<std::size_t>(i)];
      if (motor.enabled && motor.watchdog_s > 0 && arm_s_ - motor.heard_s > motor.watchdog_s) {
        motor.enabled = false;
        motor.fault = motor.drive.family == Family::damiao ? 0xD : 0;
        ++watchdogs_;
      }
      const double q = signs_[i] * (q_[i] - offsets_[i]), v = signs_[i] * v_[i];
      const Setpoint& set = motor.set;
      const double own = set.kp * (set.q - q) + set.kd * (set.v - v) + set.tau;
      motor.applied = motor.enabled
                          ? std::clamp(own, -motor.drive.ranges.tau, motor.drive.ranges.tau)
                          : -friction * v;
      tau[i] = signs_[i] * motor.applied - viscous_[i] * v_[i];
    }
    v_ += h * robot::forward_dynamics(model_, q_, v_, tau);
    q_ += h * v_;
    arm_s_ += h;
  }
}

}  // namespace tachless::mit_can
