#include "franka/robot.h"

#include <netdb.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

namespace franka {

namespace fci = tachless::fci;
using tachless::base::FileDescriptor;

class ActiveTorqueControl final : public ActiveControlBase {
 public:
  explicit ActiveTorqueControl(Robot& robot) : robot_(robot) {}
  ActiveTorqueControl(const ActiveTorqueControl&) = delete;
  ActiveTorqueControl& operator=(const ActiveTorqueControl&) = delete;
  /// Ends the process where the arm rejects the stop, as libfranka's destructor does.
  ~ActiveTorqueControl() override { robot_.stop(); }

  void writeOnce(const Torques& torques) override {
    robot_.require_connection();
    const std::lock_guard lock(robot_.receiving_);
    const fci::CommandBytes bytes = fci::encode(fci::Command{robot_.state_.id, torques.tau_J});
    ::sendto(robot_.udp_.get(), bytes.data(), bytes.size(), 0,
             reinterpret_cast<const sockaddr*>(&robot_.server_), sizeof robot_.server_);
  }

 private:
  Robot& robot_;
};

namespace {

template <class... Parts>
std::vector<std::byte> packed(const Parts&... parts) {
  std::vector<std::byte> bytes;
  const auto add = [&](const auto& part) {
    const auto raw = std::as_bytes(std::span(&part, 1));
    bytes.insert(bytes.end(), raw.begin(), raw.end());
  };
  (add(parts), ...);
  return bytes;
}

RobotState converted(const fci::State& state) {
  RobotState told;
  told.m_ee = state.end_effector_kg;
  told.m_load = state.load_kg;
  told.tau_J = state.tau_J;
  told.tau_J_d = state.tau_J_d;
  told.q = state.q;
  told.dq = state.dq;
  const auto has = [&](fci::Error error) {
    return state.reflex_reason[static_cast<std::size_t>(error)];
  };
  told.last_motion_errors.all = state.reflex_reason;
  told.last_motion_errors.joint_position_limits_violation = has(fci::Error::joint_position_limits);
  told.last_motion_errors.joint_velocity_violation = has(fci::Error::joint_velocity);
  told.last_motion_errors.joint_reflex = has(fci::Error::joint_reflex);
  told.last_motion_errors.communication_constraints_violation =
      has(fci::Error::communication_constraints);
  told.last_motion_errors.controller_torque_discontinuity = has(fci::Error::torque_discontinuity);
  told.last_motion_errors.tau_j_range_violation = has(fci::Error::tau_j_range);
  told.control_command_success_rate = state.success_rate;
  told.robot_mode = static_cast<RobotMode>(state.mode);
  told.time = Duration(state.id);
  return told;
}

}  // namespace

Errors::operator std::string() const {
  std::string text = "[";
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!all[i]) continue;
    text += std::string(text.size() > 1 ? ", " : "") + '"' +
            std::string(fci::name_of(static_cast<fci::Error>(i))) + '"';
  }
  return text + "]";
}

Robot::Robot(const std::string& address, RealtimeConfig /*config*/)
    : tcp_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)),
      udp_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  const sched_param highest{.sched_priority = ::sched_get_priority_max(SCHED_FIFO)};
  ::sched_setscheduler(0, SCHED_FIFO, &highest);
  addrinfo hints{}, *found = nullptr;
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  if (::getaddrinfo(address.c_str(), "1337", &hints, &found) != 0) {
    throw NetworkException("Connection error: Host not found");
  }
  const int connected = ::connect(tcp_.get(), found->ai_addr, found->ai_addrlen);
  ::freeaddrinfo(found);
  if (connected != 0) {
    throw NetworkException("Connection to FCI refused. Please install FCI feature or enable FCI");
  }
  const timeval second{1, 0};
  ::setsockopt(udp_.get(), SOL_SOCKET, SO_RCVTIMEO, &second, sizeof second);
  sockaddr_in here{};
  here.sin_family = AF_INET;
  socklen_t size = sizeof here;
  ::bind(udp_.get(), reinterpret_cast<const sockaddr*>(&here), size);
  ::getsockname(udp_.get(), reinterpret_cast<sockaddr*>(&here), &size);
  const Answer answer =
      ask(fci::Request::connect, packed(fci::version, std::uint16_t{ntohs(here.sin_port)}));
  if (answer.status != 0) {
    std::uint16_t server = 0;
    std::memcpy(&server, answer.more.data(), sizeof server);
    throw IncompatibleVersionException(server, fci::version);
  }
  readOnce();
}

RobotState Robot::readOnce() {
  const std::lock_guard lock(receiving_);
  fci::State newest;
  // Takes the newest state that is there, and waits where there is none.
  for (bool any = false;;) {
    fci::StateBytes bytes{};
    socklen_t size = sizeof server_;
    const auto got = ::recvfrom(udp_.get(), bytes.data(), bytes.size(), any ? MSG_DONTWAIT : 0,
                                reinterpret_cast<sockaddr*>(&server_), &size);
    if (got < 0 && any) break;
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw NetworkException("UDP receive: Timeout");
    const fci::State state = fci::decode(bytes);
    if (state.id > state_.id && state.id > newest.id) newest = state;
    any = newest.id > 0;
  }
  state_ = newest;
  return converted(state_);
}

void Robot::require_connection() const {
  char byte = 0;
  if (::recv(tcp_.get(), &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0) {
    throw NetworkException("server closed connection");
  }
}

Robot::Answer Robot::ask(fci::Request request, std::span<const std::byte> payload) {
  const std::lock_guard lock(asking_);
  const std::uint32_t id = next_id_++;
  const fci::Header header{static_cast<std::uint32_t>(request), id,
                           static_cast<std::uint32_t>(sizeof(fci::Header) + payload.size())};
  std::vector<std::byte> message = packed(header);
  message.insert(message.end(), payload.begin(), payload.end());
  if (::send(tcp_.get(), message.data(), message.size(), MSG_NOSIGNAL) < 0) {
    throw NetworkException("TCP send bytes: Broken pipe");
  }
  const auto receive = [this](void* to, std::size_t size) {
    if (::recv(tcp_.get(), to, size, MSG_WAITALL) != static_cast<ssize_t>(size)) {
      throw NetworkException("TCP receive: the connection is closed");
    }
  };
  for (;;) {  // answers to a motion that has ended meanwhile are passed over
    fci::Header answered;
    receive(&answered, sizeof answered);
    Answer answer;
    receive(&answer.status, 1);
    answer.more.resize(answered.size - sizeof answered - 1);
    if (!answer.more.empty()) receive(answer.more.data(), answer.more.size());
    if (answered.id == id) return answer;
  }
}

void Robot::command(fci::Request request, std::span<const std::byte> payload) {
  if (ask(request, payload).status != 0) {
    throw CommandException("command rejected: command not possible in the current mode");
  }
}

std::string Robot::getRobotModel() { return ask(fci::Request::get_robot_model, {}).more; }

void Robot::setCollisionBehavior(const std::array<double, 7>& lower_torques_acceleration,
                                 const std::array<double, 7>& upper_torques_acceleration,
                                 const std::array<double, 7>& lower_torques_nominal,
                                 const std::array<double, 7>& upper_torques_nominal,
                                 const std::array<double, 6>& lower_forces_acceleration,
                                 const std::array<double, 6>& upper_forces_acceleration,
                                 const std::array<double, 6>& lower_forces_nominal,
                                 const std::array<double, 6>& upper_forces_nominal) {
  command(fci::Request::set_collision_behavior,
          packed(lower_torques_acceleration, upper_torques_acceleration, lower_torques_nominal,
                 upper_torques_nominal, lower_forces_acceleration, upper_forces_acceleration,
                 lower_forces_nominal, upper_forces_nominal));
}

void Robot::setLoad(double mass, const std::array<double, 3>& center,
                    const std::array<double, 9>& inertia) {
  command(fci::Request::set_load, packed(mass, center, inertia));
}

void Robot::automaticErrorRecovery() { command(fci::Request::recover, {}); }

std::unique_ptr<ActiveControlBase> Robot::startTorqueControl() {
  constexpr std::uint32_t external_controller = 2, no_generator = 4;
  const std::array<double, 6> deviations{};
  const std::array<double, 7> velocities{};
  const Answer answer = ask(
      fci::Request::move, packed(external_controller, no_generator, deviations, false, velocities));
  if (answer.status != static_cast<std::uint8_t>(fci::MoveStatus::started)) {
    throw ControlException("Move command rejected: command not possible in the current mode");
  }
  while (!state_.controlled) readOnce();
  return std::make_unique<ActiveTorqueControl>(*this);
}

void Robot::stop() { command(fci::Request::stop_move, {}); }

}  // namespace franka
