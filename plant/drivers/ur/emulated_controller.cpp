#include "plant/drivers/ur/emulated_controller.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

#include "base/clock.h"
#include "base/elementary.h"
#include "base/failure.h"
#include "plant/drivers/loopback.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"

namespace tachless::ur {
namespace {

using namespace std::chrono_literals;
using base::Clock;

constexpr double tick_s = 2e-3;
constexpr double up_for_s = 100;  // the library waits for an arm that has just been switched on
constexpr std::int32_t mode_stopped = -2, mode_torque = 8, set_friction_scales = 11;

/// Appends a number in network byte order.
void append(std::string& to, std::uint64_t value, int bytes) {
  for (int i = bytes - 1; i >= 0; --i) to.push_back(static_cast<char>(value >> (8 * i)));
}
void append(std::string& to, double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  append(to, bits, sizeof bits);
}
/// Returns the `index`-th 32-bit number of `from`.
std::int32_t number(std::string_view from, std::size_t index) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value = value << 8 | static_cast<std::uint8_t>(from[4 * index + i]);
  }
  return static_cast<std::int32_t>(value);
}

base::FileDescriptor tcp() { return base::FileDescriptor(::socket(AF_INET, SOCK_STREAM, 0)); }

base::FileDescriptor listener(std::uint16_t port) {
  base::FileDescriptor socket = tcp();
  const int on = 1;
  ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in at = plant::loopback(port);
  if (::bind(socket.get(), plant::generic(at), sizeof at) != 0 || ::listen(socket.get(), 4) != 0) {
    throw base::bad_usage("the emulated controller cannot listen on 127.0.0.1:{}: {}", port,
                          std::strerror(errno));
  }
  return socket;
}
/// Returns a connection to the port; nothing if nobody listens there.
base::FileDescriptor connection(std::uint16_t port) {
  base::FileDescriptor socket = tcp();
  const sockaddr_in at = plant::loopback(port);
  if (::connect(socket.get(), plant::generic(at), sizeof at) != 0) return {};
  const int on = 1;
  ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  return socket;
}

bool is_ready(const base::FileDescriptor& socket) {
  pollfd one{socket.get(), POLLIN, 0};
  return socket.get() >= 0 && ::poll(&one, 1, 0) > 0;
}
/// Appends what has come. Returns false if the peer has closed the connection.
bool receive(const base::FileDescriptor& socket, std::string& to) {
  while (is_ready(socket)) {
    std::array<char, 4096> some{};
    const auto size = ::recv(socket.get(), some.data(), some.size(), 0);
    if (size <= 0) return false;
    to.append(some.data(), static_cast<std::size_t>(size));
  }
  return true;
}
void send(const base::FileDescriptor& socket, std::string_view bytes) {
  if (socket.get() >= 0) ::send(socket.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
}
void take_client(const base::FileDescriptor& from, base::FileDescriptor& client) {
  if (is_ready(from)) client = base::FileDescriptor(::accept(from.get(), nullptr, nullptr));
}

/// Returns a robot state that has the configuration data alone: 53 limits and lengths, 4 numbers.
std::string configuration() {
  std::string data;
  for (int i = 0; i < 53; ++i) append(data, 1.0);
  for (int i = 0; i < 4; ++i) append(data, 1, 4);
  std::string message;
  append(message, data.size() + 10, 4);
  append(message, 16, 1);  // robot state
  append(message, data.size() + 5, 4);
  append(message, 6, 1);  // configuration data
  return message + data;
}

std::string_view type_of(std::string_view variable) {
  if (variable.starts_with("actual_q")) return "VECTOR6D";
  if (variable == "timestamp" || variable == "speed_slider_fraction") return "DOUBLE";
  return variable == "safety_status" ? "INT32" : "UINT32";
}

std::vector<std::string> names_in(std::string_view list) {
  std::vector<std::string> names{""};
  for (const char c : list) {
    if (c == ',') {
      names.emplace_back();
    } else {
      names.back() += c;
    }
  }
  return names;
}

}  // namespace

EmulatedController::EmulatedController(const scenario::Scenario& scenario, Trouble trouble)
    : trouble_(trouble),
      model_(plant::plant_model(scenario)),
      q_(plant::initial_state(scenario.plant, scenario.robot.flexible, model_).q),
      v_(Vector::Zero(q_.size())),
      acting_(v_),
      primary_listener_(listener(30001)),
      rtde_listener_(listener(30004)) {
  if (model_.num_joints != 6) {
    throw scenario.complaint("robot.urdf", "{} joints; an arm of Universal Robots has 6",
                             model_.num_joints);
  }
  model_.gravity.setZero();  // the arm adds it
}

void EmulatedController::serve(const std::stop_token& ends) {
  const auto begin = Clock::now();
  for (; !ends.stop_requested(); ++tick_) {
    std::this_thread::sleep_until(begin + tick_ * 2ms);
    serve_primary();
    serve_rtde();
    if (sends_ && torques < trouble_.silent_from) send_state();
    if (starts_ && rtde_.get() >= 0 && tick_ % 50 == 0) start_program();
    take_torques();
    take_script_commands();
    if (torque_mode_ && static_cast<double>(tick_) * tick_s - heard_s_ > timeout_s_) end_program();
    move();
  }
}

void EmulatedController::serve_primary() {
  take_client(primary_listener_, primary_);
  primary_in_.clear();
  if (!receive(primary_, primary_in_)) primary_ = base::FileDescriptor();
  if (!primary_in_.empty()) {
    end_program();
    starts_ = true;
  }
  if (tick_ % 50 == 0) send(primary_, configuration());
}

void EmulatedController::serve_rtde() {
  if (is_ready(rtde_listener_)) {
    take_client(rtde_listener_, rtde_);
    sends_ = false;
    rtde_in_.clear();
  }
  if (!receive(rtde_, rtde_in_)) {
    rtde_ = base::FileDescriptor();
    sends_ = false;
  }
  while (rtde_in_.size() >= 3) {
    const std::size_t size =
        static_cast<std::uint8_t>(rtde_in_[0]) << 8 | static_cast<std::uint8_t>(rtde_in_[1]);
    if (rtde_in_.size() < size) break;
    answer(rtde_in_[2], rtde_in_.substr(3, size - 3));
    rtde_in_.erase(0, size);
  }
}

void EmulatedController::answer(char type, std::string_view body) {
  std::string data;
  switch (type) {
    case 'S':
    case 'P':
      sends_ = type == 'S';
      [[fallthrough]];
    case 'V':
      data.push_back(1);
      break;
    case 'v':  // 5.25.1
      for (const int part : {5, 25, 1, 0}) append(data, static_cast<std::uint64_t>(part), 4);
      break;
    case 'O':
    case 'I': {
      const auto names = names_in(body.substr(type == 'O' ? 8 : 0));
      if (type == 'O') recipe_ = names;
      data.push_back(1);
      for (const std::string& name : names) {
        if (data.size() > 1) data.push_back(',');
        data += type_of(name);
      }
      break;
    }
    default:
      return;
  }
  std::string message;
  append(message, data.size() + 3, 2);
  message.push_back(type);
  send(rtde_, message + data);
}

void EmulatedController::send_state() {
  std::string data(1, 1);
  for (const std::string& name : recipe_) {
    if (name == "timestamp") {
      append(data, up_for_s + static_cast<double>(tick_) * tick_s);
    } else if (name.starts_with("actual_q")) {
      for (const double value : name == "actual_q" ? q_ : v_) append(data, value);
    } else {
      append(data, name == "safety_status" ? static_cast<std::uint64_t>(safety_) : 1, 4);
    }
  }
  std::string message;
  append(message, data.size() + 3, 2);
  message.push_back('U');
  send(rtde_, message + data);
}

void EmulatedController::start_program() {
  trajectory_ = connection(50003);
  script_ = connection(50004);
  torque_ = connection(50001);
  program_runs = torque_.get() >= 0;
  starts_ = !program_runs;
}

void EmulatedController::end_program() {
  torque_mode_ = program_runs = false;
  torque_in_.clear();
  script_in_.clear();
  for (auto* each : {&torque_, &trajectory_, &script_}) *each = base::FileDescriptor();
}

void EmulatedController::take_torques() {
  constexpr std::size_t size = 8 * 4;  // time-out, six torques, mode
  if (torque_.get() < 0) return;
  if (!receive(torque_, torque_in_)) return end_program();
  for (; torque_in_.size() >= size; torque_in_.erase(0, size)) {
    const std::int32_t mode = number(torque_in_, 7);
    if (mode == mode_stopped) return end_program();
    torque_mode_ = mode == mode_torque;
    if (!torque_mode_) continue;
    timeout_s_ = 1e-3 * number(torque_in_, 0);
    heard_s_ = static_cast<double>(tick_) * tick_s;
    for (Eigen::Index i = 0; i < acting_.size(); ++i) {
      acting_[i] = 1e-6 * number(torque_in_, static_cast<std::size_t>(i + 1));
    }
    ++torques;
    if (torques == trouble_.protective_stop_at) safety_ = 3;
    if (torques == trouble_.protective_stop_at || torques == trouble_.program_ends_at) {
      return end_program();
    }
  }
}

void EmulatedController::take_script_commands() {
  constexpr std::size_t numbers = 28;
  receive(script_, script_in_);
  for (; script_in_.size() >= 4 * numbers; script_in_.erase(0, 4 * numbers)) {
    if (number(script_in_, 0) != set_friction_scales) continue;
    scales.clear();
    for (std::size_t i = 1; i <= 12; ++i) scales.push_back(number(script_in_, i));
  }
}

void EmulatedController::move() {
  constexpr int steps = 20;
  constexpr double step_s = tick_s / steps, braking_s = 0.02;
  for (int i = 0; i < steps; ++i) {
    if (torque_mode_) {
      v_ += step_s * robot::forward_dynamics(model_, q_, v_, acting_);
    } else {
      v_ *= base::exp(-step_s / braking_s);  // stopj
    }
    q_ += step_s * v_;
  }
}

}  // namespace tachless::ur
