#include "plant/drivers/franka/emulated_arm.h"

#include <fmt/format.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <utility>

#include "base/elementary.h"
#include "base/failure.h"
#include "plant/drivers/loopback.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"

namespace tachless::fci {
namespace {

using namespace std::chrono_literals;
using base::Clock;

constexpr auto tick_length = 1ms;
constexpr auto answer_window = 500us;
constexpr auto longest_patience = 40ms;
constexpr int steps_a_tick = 10;
constexpr double step_s = 1e-4;
constexpr double friction_slope = 100;  // [s/rad]

constexpr Joints sensor_range = {87, 87, 87, 87, 12, 12, 12};            // [N m]
constexpr Joints deceleration = {6, 2.585, 3.5, 4, 17, 5.5, 17};         // [rad/s2]
constexpr Joints speed_offset = {0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35};  // [rad/s]
constexpr double most_change = 1;                                        // [N m] in a tick
constexpr int most_lost = 20;                                            // commands in a row
constexpr double end_effector = 0.7126;                                  // of the hand [kg]

/// Returns a URDF with the limits near the ends of the ranges, which libfranka reads. A URDF that
/// has its own stays as it is.
std::string with_position_dependent_limits(std::string urdf) {
  if (urdf.find("<position_based_velocity_limits") != std::string::npos) return urdf;
  std::size_t at = 0;
  for (std::size_t i = 0; i < num_joints; ++i) {
    at = urdf.find("<limit", at);
    at = urdf.find('>', at);
    if (at == std::string::npos) break;
    urdf.insert(++at, fmt::format("<position_based_velocity_limits deceleration_limit=\"{}\" "
                                  "velocity_offset=\"{}\"/>",
                                  deceleration[i], speed_offset[i]));
  }
  return urdf;
}

template <class T>
T number_at(std::span<const std::byte> payload, std::size_t at) {
  T value{};
  if (payload.size() >= at + sizeof value) std::memcpy(&value, payload.data() + at, sizeof value);
  return value;
}

}  // namespace

EmulatedArm::EmulatedArm(const scenario::Scenario& scenario, Pace pace, Trouble trouble)
    : pace_(pace),
      trouble_(std::move(trouble)),
      model_(plant::plant_model(scenario)),
      weight_(model_),
      q_(plant::initial_state(scenario.plant, scenario.robot.flexible, model_).q),
      v_(Vector::Zero(model_.num_joints)),
      external_(v_) {
  if (model_.num_joints != static_cast<int>(num_joints)) {
    throw scenario.complaint("robot.urdf", "{} joints; a Franka arm has 7", model_.num_joints);
  }
  model_.gravity.setZero();
  model_.deceleration_limit = Eigen::Map<const Eigen::VectorXd>(deceleration.data(), num_joints);
  model_.velocity_offset = Eigen::Map<const Eigen::VectorXd>(speed_offset.data(), num_joints);
  q_[0] += trouble_.offset_rad;
  urdf_ = with_position_dependent_limits(trouble_.urdf.empty() ? scenario.robot.urdf_text
                                                               : trouble_.urdf);
  thresholds_.fill(0);
  state_.mode = trouble_.mode;
  state_.end_effector_kg = end_effector;
  listener_ = base::FileDescriptor(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  udp_ = base::FileDescriptor(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const int yes = 1;
  ::setsockopt(listener_.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  const sockaddr_in at = plant::loopback(tcp_port), any = plant::loopback(0);
  if (::bind(listener_.get(), plant::generic(at), sizeof at) != 0 ||
      ::listen(listener_.get(), 4) != 0 ||
      ::bind(udp_.get(), plant::generic(any), sizeof any) != 0) {
    throw base::bad_usage("the emulated arm cannot listen on 127.0.0.1:{}: {}", tcp_port,
                          std::strerror(errno));
  }
}

void EmulatedArm::serve(const std::stop_token& ends) {
  const auto brakes = [this] { return state_.mode != Mode::move && speed() > 0; };
  for (Time tick = Clock::now(); (!ends.stop_requested() || brakes()) && !dead_;) {
    begin_tick(tick);
    const Time end = tick + tick_length;
    while (Clock::now() < end) attend(end);
    tick = end;
    if (pace_ == Pace::as_the_arm) continue;
    const Time last = told_at_ + longest_patience;
    while (is_awaiting() && Clock::now() < last) attend(last);
    tick = std::max(end, Clock::now());
  }
  if (!dead_) return;
  listener_ = base::FileDescriptor();
  while (speed() > 0) brake();
}

bool EmulatedArm::has_client() const {
  char byte = 0;
  if (client_.get() < 0) return false;
  const auto size = ::recv(client_.get(), &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  return size > 0 || (size < 0 && errno == EAGAIN);
}

bool EmulatedArm::is_awaiting() const {
  return told_ && state_.mode == Mode::move && !command_ && client_.get() >= 0;
}

void EmulatedArm::begin_tick(Time now) {
  ++state_.id;
  acting_ = state_.tau_J_d;
  if (state_.mode == Mode::move && told_) {
    begin_incidents();
    if (state_.mode == Mode::move) take_command_of_tick();
  }
  if (state_.mode == Mode::move) {
    move();
    watch();
    ++moving_ms_;
  } else {
    brake();
  }
  told_at_ = std::max(now, Clock::now());
  if (!frozen_) send_state();
}

void EmulatedArm::begin_incidents() {
  for (const Incident& incident : trouble_.incidents) {
    if (incident.at_ms != moving_ms_) continue;
    switch (incident.event) {
      case Event::external_torque:
        external_[static_cast<Eigen::Index>(incident.joint)] = incident.torque_Nm;
        break;
      case Event::user_stop:
        end_motion(MoveStatus::emergency_aborted, Mode::user_stopped);
        break;
      case Event::lose_commands:
        commands_to_lose_ = incident.count;
        break;
      case Event::lose_states:
        states_to_lose_ = incident.count;
        break;
      case Event::die:
        dead_ = true;
        [[fallthrough]];
      case Event::close:
        close_client();
        break;
      case Event::freeze:
        frozen_ = true;
        break;
      case Event::mute_reflex:
        muted_ = true;
        reflex(Error::joint_reflex);
        break;
    }
  }
}

void EmulatedArm::take_command_of_tick() {
  bool lost = !command_ || std::uniform_real_distribution<>()(random_) < trouble_.lost_share;
  if (commands_to_lose_ > 0) {
    --commands_to_lose_;
    lost = true;
  }
  window_[state_.id % window_.size()] = !lost;
  const std::optional<Command> command = std::exchange(command_, {});
  if (lost) {  // the last torque is held
    longest_loss_ = std::max(longest_loss_, ++lost_in_a_row_);
    if (lost_in_a_row_ > most_lost) reflex(Error::communication_constraints);
    return;
  }
  lost_in_a_row_ = 0;
  const Vector gravity = robot::gravity_torque(weight_, q_);
  for (std::size_t i = 0; i < num_joints; ++i) {
    // The arm knows what it took in double precision. It tells it in single precision.
    const double change = std::abs(command->tau[i] - state_.tau_J_d[i]);
    largest_change_ = std::max(largest_change_, change);
    if (!(change <= most_change)) return reflex(Error::torque_discontinuity);
    if (std::abs(command->tau[i] + gravity[static_cast<Eigen::Index>(i)]) > sensor_range[i]) {
      return reflex(Error::tau_j_range);
    }
  }
  state_.tau_J_d = command->tau;
  if (command->finished) end_motion(MoveStatus::success, Mode::idle);
}

void EmulatedArm::move() {
  const Vector given = Eigen::Map<const Eigen::VectorXd>(acting_.data(), num_joints);
  for (int i = 0; i < steps_a_tick; ++i) {
    const Vector friction = v_.unaryExpr([](double v) { return base::tanh(friction_slope * v); });
    const Vector tau = given + external_ - trouble_.friction_Nm * friction;
    const Vector a = robot::forward_dynamics(model_, q_, v_, tau);
    q_ += step_s * (v_ + 0.5 * step_s * a);
    v_ += step_s * a;
  }
}

void EmulatedArm::brake() {
  constexpr double left_after_a_tick = 0.9, standstill = 1e-4;
  q_ += base::seconds_of(tick_length) * v_;
  v_ *= left_after_a_tick;
  if (speed() < standstill) v_.setZero();
}

void EmulatedArm::watch() {
  for (std::size_t j = 0; j < num_joints; ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    if (q_[i] < model_.lower[i] || q_[i] > model_.upper[i]) reflex(Error::joint_position_limits);
    if (std::abs(v_[i]) > robot::speed_limit(model_, i, q_[i], v_[i])) {
      reflex(Error::joint_velocity);
    }
    if (std::abs(external_[i]) > thresholds_[j]) reflex(Error::joint_reflex);
  }
}

void EmulatedArm::send_state() {
  told_ = false;
  if (ntohs(client_address_.sin_port) == 0) return;
  if (state_.mode == Mode::move && states_to_lose_ > 0) {
    --states_to_lose_;
    // The client cannot answer this state: its tick counts as one with a lost command.
    told_ = true;
    told_at_ -= longest_patience;
    return;
  }
  const Vector gravity = robot::gravity_torque(weight_, q_);
  for (std::size_t j = 0; j < num_joints; ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    state_.q[j] = q_[i];
    state_.dq[j] = v_[i];
    state_.tau_J[j] = acting_[j] + gravity[i];
    state_.external[j] = external_[i];
  }
  const auto came = std::ranges::count(window_, true);
  state_.success_rate = state_.mode == Mode::move
                            ? static_cast<double>(came) / static_cast<double>(window_.size())
                            : 0;
  const StateBytes bytes = encode(state_);
  ::sendto(udp_.get(), bytes.data(), bytes.size(), 0, plant::generic(client_address_),
           sizeof client_address_);
  told_ = state_.mode == Mode::move;
}

void EmulatedArm::attend(Time until) {
  std::array<pollfd, 3> ready = {pollfd{udp_.get(), POLLIN, 0}, pollfd{listener_.get(), POLLIN, 0},
                                 pollfd{client_.get(), POLLIN, 0}};
  const auto left = std::clamp<std::chrono::nanoseconds>(until - Clock::now(), 0ns, 10ms);
  const timespec wait = {0, left.count()};
  if (::ppoll(ready.data(), ready.size(), &wait, nullptr) <= 0) return;
  if (frozen_) {  // what arrives stays there
    const timespec pause = {0, 100'000};
    ::nanosleep(&pause, nullptr);
    return;
  }
  if (ready[0].revents != 0) take_command();
  if (ready[2].revents != 0) take_request();  // it may be the end of a client before the next one
  if (ready[1].revents != 0) take_client();
}

void EmulatedArm::take_command() {
  CommandBytes bytes{};
  const auto size = ::recv(udp_.get(), bytes.data(), bytes.size(), 0);
  if (size != static_cast<ssize_t>(bytes.size())) return;
  const Command command = decode(bytes);
  if (command.id != state_.id || state_.mode != Mode::move) return;
  if (pace_ == Pace::as_the_arm && Clock::now() > told_at_ + answer_window) return;
  command_ = command;
}

void EmulatedArm::take_client() {
  base::FileDescriptor client(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
  if (client_.get() >= 0) return;  // one client at a time
  const int yes = 1;
  ::setsockopt(client.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  client_ = std::move(client);
}

void EmulatedArm::close_client() {
  client_ = base::FileDescriptor();
  client_address_ = {};
  reflex(Error::communication_constraints);  // the arm does not move on without its client
}

void EmulatedArm::take_request() {
  constexpr std::uint32_t longest = 4096;
  Header header;
  const auto receive = [this](void* to, std::size_t size) {
    return ::recv(client_.get(), to, size, MSG_WAITALL) == static_cast<ssize_t>(size);
  };
  if (!receive(&header, sizeof header) || header.size < sizeof header || header.size > longest) {
    return close_client();
  }
  std::vector<std::byte> payload(header.size - sizeof header);
  if (!payload.empty() && !receive(payload.data(), payload.size())) return close_client();
  handle(static_cast<Request>(header.request), header.id, payload);
}

void EmulatedArm::handle(Request request, std::uint32_t id, std::span<const std::byte> payload) {
  constexpr std::uint8_t success = 0, not_possible = 1;
  const bool moving = state_.mode == Mode::move;
  switch (request) {
    case Request::connect:
      return connect(id, payload);
    case Request::move:
      if (state_.mode != Mode::idle) {
        return respond(request, id, static_cast<std::uint8_t>(MoveStatus::not_possible));
      }
      begin_motion(id);
      return respond(request, id, static_cast<std::uint8_t>(MoveStatus::started));
    case Request::stop_move:
      if (!moving && trouble_.refuses_late_stop) return respond(request, id, not_possible);
      if (moving) end_motion(MoveStatus::preempted, Mode::idle);
      return respond(request, id, success);
    case Request::recover:
      if (state_.mode == Mode::reflex) {
        state_.mode = Mode::idle;
        state_.errors.fill(false);
      }
      return respond(request, id, state_.mode == Mode::idle ? success : not_possible);
    case Request::get_robot_model:
      return respond(request, id, success, std::as_bytes(std::span(urdf_)));
    case Request::set_collision_behavior:
    case Request::set_load:
      break;
  }
  if (moving) return respond(request, id, not_possible);
  if (request == Request::set_load && !trouble_.ignores_load) {
    state_.load_kg = number_at<double>(payload, 0);
  }
  if (request == Request::set_collision_behavior) {  // the upper nominal ones are the fourth
    thresholds_ = number_at<Joints>(payload, 3 * sizeof(Joints));
  }
  respond(request, id, success);
}

void EmulatedArm::connect(std::uint32_t id, std::span<const std::byte> payload) {
  constexpr std::uint8_t success = 0, incompatible = 1;
  const bool fits = number_at<std::uint16_t>(payload, 0) == trouble_.version;
  respond(Request::connect, id, fits ? success : incompatible,
          std::as_bytes(std::span(&trouble_.version, 1)));
  if (fits) client_address_ = plant::loopback(number_at<std::uint16_t>(payload, 2));
}

void EmulatedArm::respond(Request request, std::uint32_t id, std::uint8_t status,
                          std::span<const std::byte> more) {
  if (client_.get() < 0 || muted_) return;
  const Header header{static_cast<std::uint32_t>(request), id,
                      static_cast<std::uint32_t>(sizeof(Header) + 1 + more.size())};
  std::vector<std::byte> bytes(header.size);
  std::memcpy(bytes.data(), &header, sizeof header);
  bytes[sizeof header] = std::byte{status};
  std::ranges::copy(more, bytes.begin() + sizeof header + 1);
  ::send(client_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
}

void EmulatedArm::begin_motion(std::uint32_t id) {
  move_id_ = id;
  ++motions_;
  state_.mode = Mode::move;
  state_.controlled = true;
  state_.errors.fill(false);
  state_.reflex_reason.fill(false);
  state_.tau_J_d.fill(0);
  command_.reset();
  told_ = false;
  window_.fill(true);
  moving_ms_ = 0;
  lost_in_a_row_ = 0;
}

void EmulatedArm::reflex(Error error) {
  if (state_.mode != Mode::move) return;
  state_.errors[static_cast<std::size_t>(error)] = true;
  state_.reflex_reason[static_cast<std::size_t>(error)] = true;
  end_motion(MoveStatus::reflex_aborted, Mode::reflex);
}

void EmulatedArm::end_motion(MoveStatus status, Mode mode) {
  state_.mode = mode;
  state_.controlled = false;
  state_.tau_J_d.fill(0);
  external_.setZero();
  respond(Request::move, move_id_, static_cast<std::uint8_t>(status));
}

}  // namespace tachless::fci
