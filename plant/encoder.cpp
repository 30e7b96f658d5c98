#include "plant/encoder.h"

#include <array>
#include <cmath>
#include <numbers>
#include <string>

namespace tachless::plant {
namespace {

using Block = std::array<std::uint32_t, 4>;

/// Philox4x32-10: a block cipher used as a random function of its counter.
Block philox(Block counter, std::uint64_t seed) {
  std::uint32_t key_0 = static_cast<std::uint32_t>(seed);
  std::uint32_t key_1 = static_cast<std::uint32_t>(seed >> 32);
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t a = std::uint64_t{0xD2511F53} * counter[0];
    const std::uint64_t b = std::uint64_t{0xCD9E8D57} * counter[2];
    counter = {
        static_cast<std::uint32_t>(b >> 32) ^ counter[1] ^ key_0, static_cast<std::uint32_t>(b),
        static_cast<std::uint32_t>(a >> 32) ^ counter[3] ^ key_1, static_cast<std::uint32_t>(a)};
    key_0 += 0x9E3779B9;
    key_1 += 0xBB67AE85;
  }
  return counter;
}

/// Uniform in (0, 1), never 0, from 53 of 64 bits.
double uniform(std::uint32_t high, std::uint32_t low) {
  const std::uint64_t bits = (std::uint64_t{high} << 32 | low) >> 11;
  return (static_cast<double>(bits) + 0.5) * 0x1p-53;
}

void require_link_side(const experiment::Scenario& scenario) {
  // A rigid joint has one position, whichever side its encoder sits on.
  if (!scenario.robot.flexible || scenario.plant.encoder.side != EncoderSide::motor) return;
  throw scenario.complaint("plant.encoder.side",
                           "motor, but law " + scenario.controller.law +
                               " measures link positions; allowed: link, both");
}

void require_motor_side(const experiment::Scenario& scenario) {
  if (!scenario.robot.flexible) {
    throw scenario.complaint("robot.joints", "rigid, but law " + scenario.controller.law +
                                                 " measures motor positions; allowed: flexible");
  }
  if (scenario.plant.encoder.side != EncoderSide::link) return;
  throw scenario.complaint("plant.encoder.side",
                           "link, but law " + scenario.controller.law +
                               " measures motor positions; allowed: motor, both");
}

}  // namespace

double standard_normal(std::uint64_t seed, std::int64_t tick, std::uint32_t channel,
                       std::uint32_t joint) {
  const auto t = static_cast<std::uint64_t>(tick);
  const Block random = philox(
      {static_cast<std::uint32_t>(t), static_cast<std::uint32_t>(t >> 32), channel, joint}, seed);
  return std::sqrt(-2 * std::log(uniform(random[0], random[1]))) *
         std::cos(2 * std::numbers::pi * uniform(random[2], random[3]));
}

Encoder::Encoder(const experiment::Scenario& scenario, const robot::Model& model)
    : count_(experiment::encoder_count(scenario, model)),
      position_noise_(scenario.plant.encoder.noise_std_rad),
      velocity_noise_(scenario.plant.encoder.velocity_noise_std_rad_per_s),
      seed_(scenario.plant.encoder.seed) {}

robot::Vector Encoder::position(const robot::Vector& exact, Channel channel,
                                std::int64_t tick) const {
  robot::Vector measured = exact;
  for (Eigen::Index i = 0; i < exact.size(); ++i) {
    if (position_noise_ > 0) {
      measured[i] +=
          position_noise_ * standard_normal(seed_, tick, static_cast<std::uint32_t>(channel),
                                            static_cast<std::uint32_t>(i));
    }
    if (count_[i] > 0) measured[i] = std::round(measured[i] / count_[i]) * count_[i];
  }
  return measured;
}

robot::Vector Encoder::velocity(const robot::Vector& exact, Channel channel,
                                std::int64_t tick) const {
  robot::Vector measured = exact;
  if (velocity_noise_ > 0) {
    for (Eigen::Index i = 0; i < exact.size(); ++i) {
      measured[i] +=
          velocity_noise_ * standard_normal(seed_, tick, static_cast<std::uint32_t>(channel),
                                            static_cast<std::uint32_t>(i));
    }
  }
  return measured;
}

template <>
loop::PositionMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const {
  return {position(state.q, Channel::link_position, tick)};
}

template <>
loop::MotorPositionMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const {
  return {position(state.theta, Channel::motor_position, tick)};
}

template <>
loop::LinkStateMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const {
  return {position(state.q, Channel::link_position, tick),
          velocity(state.v, Channel::link_velocity, tick),
          position(state.theta, Channel::motor_position, tick)};
}

template <>
loop::StateMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const {
  return {position(state.q, Channel::link_position, tick),
          velocity(state.v, Channel::link_velocity, tick),
          position(state.theta, Channel::motor_position, tick),
          velocity(state.thetadot, Channel::motor_velocity, tick)};
}

template <>
void require_encoders<loop::PositionMeasurement>(const experiment::Scenario& scenario) {
  require_link_side(scenario);
}

template <>
void require_encoders<loop::MotorPositionMeasurement>(const experiment::Scenario& scenario) {
  require_motor_side(scenario);
}

template <>
void require_encoders<loop::LinkStateMeasurement>(const experiment::Scenario& scenario) {
  require_link_side(scenario);
  require_motor_side(scenario);
}

template <>
void require_encoders<loop::StateMeasurement>(const experiment::Scenario& scenario) {
  require_link_side(scenario);
  if (scenario.robot.flexible) require_motor_side(scenario);
}

}  // namespace tachless::plant
