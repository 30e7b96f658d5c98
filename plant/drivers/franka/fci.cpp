#include "plant/drivers/franka/fci.h"

#include <cstring>
#include <stdexcept>

namespace tachless::fci {
namespace {

// Places of the single-precision numbers in a state. Its message number comes before them.
enum Place : std::size_t {
  end_effector_mass = 96,
  load_mass = 109,
  torque = 126,
  accepted_torque = 133,
  position = 147,
  desired_position = 154,
  velocity = 161,
  external_torque = 208,
  motor_position = 270,
  motor_velocity = 277,
  num_numbers = 320
};
constexpr std::size_t numbers_at = sizeof(std::uint64_t);
constexpr std::size_t generator_at = numbers_at + num_numbers * sizeof(float);
constexpr std::size_t controller_at = generator_at + 1;
constexpr std::size_t errors_at = controller_at + 1;
constexpr std::size_t reasons_at = errors_at + num_errors;
constexpr std::size_t mode_at = reasons_at + num_errors;
constexpr std::size_t rate_at = mode_at + 1;
static_assert(rate_at + sizeof(float) == std::tuple_size_v<StateBytes>);

constexpr std::uint8_t no_generator = 5, idle_generator = 0;
constexpr std::uint8_t external_controller = 2, other_controller = 3;

// Places of the parts of a command. A motion generator's numbers are between id and torques.
constexpr std::size_t generator_size = 38 * sizeof(double) + 2;
constexpr std::size_t torques_at = sizeof(std::uint64_t) + generator_size;
constexpr std::size_t finished_at = torques_at + sizeof(Joints);
static_assert(finished_at + 1 == std::tuple_size_v<CommandBytes>);

template <class Bytes, class T>
void put(Bytes& bytes, std::size_t at, const T& value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}
template <class T, class Bytes>
T get(const Bytes& bytes, std::size_t at) {
  T value{};
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void put_number(StateBytes& bytes, std::size_t place, double value) {
  put(bytes, numbers_at + place * sizeof(float), static_cast<float>(value));
}
double get_number(const StateBytes& bytes, std::size_t place) {
  return static_cast<double>(get<float>(bytes, numbers_at + place * sizeof(float)));
}
void put_joints(StateBytes& bytes, std::size_t place, const Joints& values) {
  for (std::size_t i = 0; i < num_joints; ++i) put_number(bytes, place + i, values[i]);
}
Joints get_joints(const StateBytes& bytes, std::size_t place) {
  Joints values{};
  for (std::size_t i = 0; i < num_joints; ++i) values[i] = get_number(bytes, place + i);
  return values;
}

}  // namespace

std::string_view name_of(Error error) {
  switch (error) {
    case Error::joint_position_limits:
      return "joint_position_limits_violation";
    case Error::joint_velocity:
      return "joint_velocity_violation";
    case Error::joint_reflex:
      return "joint_reflex";
    case Error::communication_constraints:
      return "communication_constraints_violation";
    case Error::torque_discontinuity:
      return "controller_torque_discontinuity";
    case Error::tau_j_range:
      return "tau_J_range_violation";
  }
  throw std::logic_error("no name of this error");
}

StateBytes encode(const State& state) {
  StateBytes bytes{};
  put(bytes, 0, state.id);
  put_number(bytes, end_effector_mass, state.end_effector_kg);
  put_number(bytes, load_mass, state.load_kg);
  put_joints(bytes, torque, state.tau_J);
  put_joints(bytes, accepted_torque, state.tau_J_d);
  for (const Place place : {position, desired_position, motor_position}) {
    put_joints(bytes, place, state.q);
  }
  for (const Place place : {velocity, motor_velocity}) put_joints(bytes, place, state.dq);
  put_joints(bytes, external_torque, state.external);
  put(bytes, generator_at, state.controlled ? no_generator : idle_generator);
  put(bytes, controller_at, state.controlled ? external_controller : other_controller);
  put(bytes, errors_at, state.errors);
  put(bytes, reasons_at, state.reflex_reason);
  put(bytes, mode_at, state.mode);
  put(bytes, rate_at, static_cast<float>(state.success_rate));
  return bytes;
}

State decode(const StateBytes& bytes) {
  State state;
  state.id = get<std::uint64_t>(bytes, 0);
  state.end_effector_kg = get_number(bytes, end_effector_mass);
  state.load_kg = get_number(bytes, load_mass);
  state.tau_J = get_joints(bytes, torque);
  state.tau_J_d = get_joints(bytes, accepted_torque);
  state.q = get_joints(bytes, position);
  state.dq = get_joints(bytes, velocity);
  state.external = get_joints(bytes, external_torque);
  state.controlled = get<std::uint8_t>(bytes, controller_at) == external_controller;
  for (std::size_t i = 0; i < num_errors; ++i) {
    state.errors[i] = bytes[errors_at + i] != std::byte{0};
    state.reflex_reason[i] = bytes[reasons_at + i] != std::byte{0};
  }
  state.mode = get<Mode>(bytes, mode_at);
  state.success_rate = static_cast<double>(get<float>(bytes, rate_at));
  return state;
}

CommandBytes encode(const Command& command) {
  CommandBytes bytes{};
  put(bytes, 0, command.id);
  put(bytes, torques_at, command.tau);
  put(bytes, finished_at, command.finished);
  return bytes;
}

Command decode(const CommandBytes& bytes) {
  return {get<std::uint64_t>(bytes, 0), get<Joints>(bytes, torques_at),
          bytes[finished_at] != std::byte{0}};
}

}  // namespace tachless::fci
