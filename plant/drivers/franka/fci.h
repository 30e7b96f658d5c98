#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

/// Bytes of the Franka Control Interface, protocol version 10 (libfranka 0.18 and later): requests
/// by TCP, states and commands by UDP, little-endian, without padding. The layout is that of the
/// headers that the maker publishes (frankarobotics/libfranka-common at d96c221); the code is our
/// own.
namespace tachless::fci {

inline constexpr std::size_t num_joints = 7;
inline constexpr std::size_t num_errors = 41;
inline constexpr std::uint16_t version = 10;
inline constexpr std::uint16_t tcp_port = 1337;
using Joints = std::array<double, num_joints>;

enum class Request : std::uint32_t {
  connect = 0,
  move = 1,
  stop_move = 2,
  set_collision_behavior = 3,
  set_load = 9,
  recover = 10,
  get_robot_model = 11
};

/// Beginning of each TCP message. `size` counts the header too.
struct Header {
  std::uint32_t request = 0, id = 0, size = 0;
};
static_assert(sizeof(Header) == 12);

/// Modes of the arm, in the interface's order.
enum class Mode : std::uint8_t { other, idle, move, guiding, reflex, user_stopped, recovery };

/// Status of an answer to `Request::move`.
enum class MoveStatus : std::uint8_t {
  success = 0,
  started = 1,
  preempted = 2,
  not_possible = 5,
  reflex_aborted = 8,
  emergency_aborted = 9
};

/// Indices of errors in `State::errors`.
enum class Error : std::size_t {
  joint_position_limits = 0,
  joint_velocity = 3,
  joint_reflex = 6,
  communication_constraints = 25,
  torque_discontinuity = 32,
  tau_j_range = 34
};

/// Returns the maker's name of an error: "joint_reflex".
std::string_view name_of(Error error);

/// Fields of the arm's state that tachless reads or emulates. The state holds single precision.
struct State {
  std::uint64_t id = 0;  ///< number of the arm's millisecond
  double end_effector_kg = 0, load_kg = 0;
  Joints tau_J{};           ///< measured, with gravity [N m]
  Joints tau_J_d{};         ///< torque that the arm accepted, without gravity [N m]
  Joints q{}, dq{};         ///< [rad; rad/s]
  Joints external{};        ///< filtered external torque [N m]
  bool controlled = false;  ///< a client's torques act
  std::array<bool, num_errors> errors{}, reflex_reason{};
  Mode mode = Mode::idle;
  double success_rate = 0;  ///< share of the last 100 commands that arrived
};

using StateBytes = std::array<std::byte, 1377>;
StateBytes encode(const State& state);
State decode(const StateBytes& bytes);

/// Torques that answer a state.
struct Command {
  std::uint64_t id = 0;  ///< number of the answered state
  Joints tau{};          ///< without gravity [N m]
  bool finished = false;
};

using CommandBytes = std::array<std::byte, 371>;
CommandBytes encode(const Command& command);
Command decode(const CommandBytes& bytes);

}  // namespace tachless::fci
