#include "bus/truth/truth_wire.h"

#include <tachless_truth/plant_truth_t.hpp>

#include "bus/codec.h"

namespace tachless::bus {

bool all_finite(const loop::truth::PlantTruth& value) {
  return value.q.allFinite() && value.v.allFinite() && value.theta.allFinite() &&
         value.thetadot.allFinite() && value.tau.allFinite();
}

template <>
struct Translation<loop::truth::PlantTruth> {
  using Message = tachless_truth::plant_truth_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    using Kind = Field::Kind;
    const int n = layout.num_joints;
    const int m = layout.num_motors;
    return {Message::getHash(),
            {{Kind::count, n},
             {Kind::count, m},
             {Kind::real, 3 * n + 2 * m},
             {Kind::boolean, n},
             {Kind::int8}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.num_motors = layout.num_motors;
    message.position.resize(layout.num_joints);
    message.velocity.resize(layout.num_joints);
    message.motor_position.resize(layout.num_motors);
    message.motor_velocity.resize(layout.num_motors);
    message.torque.resize(layout.num_joints);
    message.saturated.resize(layout.num_joints);
  }
  static void write(const loop::truth::PlantTruth& value, const loop::Layout& layout,
                    Message& message) {
    put(value.q, layout.num_joints, "q", message.position);
    put(value.v, layout.num_joints, "v", message.velocity);
    put(value.theta, layout.num_motors, "theta", message.motor_position);
    put(value.thetadot, layout.num_motors, "thetadot", message.motor_velocity);
    put(value.tau, layout.num_joints, "tau", message.torque);
    for (int i = 0; i < layout.num_joints; ++i) message.saturated[i] = value.saturated[i] ? 1 : 0;
    message.fault = static_cast<std::int8_t>(value.fault);
    if (check(message) != Rejection::none) throw std::logic_error("bus::Codec: no such fault");
  }
  static Rejection check(const Message& message) {
    const auto last = static_cast<std::int8_t>(loop::truth::DriveFault::protective_stop);
    return message.fault >= 0 && message.fault <= last ? Rejection::none : Rejection::bad_value;
  }
  static void read(const Message& message, loop::truth::PlantTruth& value) {
    get(message.position, value.q);
    get(message.velocity, value.v);
    get(message.motor_position, value.theta);
    get(message.motor_velocity, value.thetadot);
    get(message.torque, value.tau);
    value.saturated.fill(false);
    for (int i = 0; i < message.num_joints; ++i) value.saturated[i] = message.saturated[i] != 0;
    value.fault = static_cast<loop::truth::DriveFault>(message.fault);
  }
};

template class Codec<loop::truth::PlantTruth>;

}  // namespace tachless::bus
