#include "plant/encoder.h"

#include <array>
#include <cmath>
#include <numbers>

#include "base/elementary.h"

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

/// Returns a number in (0, 1), from 52 of 64 bits: with 53 the largest would round to 1.
double uniform(std::uint32_t high, std::uint32_t low) {
  const std::uint64_t bits = (std::uint64_t{high} << 32 | low) >> 12;
  return (static_cast<double>(bits) + 0.5) * 0x1p-52;
}

}  // namespace

double standard_normal(std::uint64_t seed, std::int64_t tick, std::uint32_t channel,
                       std::uint32_t joint) {
  const auto t = static_cast<std::uint64_t>(tick);
  const Block random = philox(
      {static_cast<std::uint32_t>(t), static_cast<std::uint32_t>(t >> 32), channel, joint}, seed);
  return std::sqrt(-2 * base::log(uniform(random[0], random[1]))) *
         base::cos(2 * std::numbers::pi * uniform(random[2], random[3]));
}

double standard_uniform(std::uint64_t seed, std::int64_t tick) {
  constexpr std::uint32_t channel = 32;  // the encoders' are below
  const auto t = static_cast<std::uint64_t>(tick);
  const Block random = philox(
      {static_cast<std::uint32_t>(t), static_cast<std::uint32_t>(t >> 32), channel, 0}, seed);
  return uniform(random[0], random[1]);
}

Encoder::Encoder(const EncoderSpec& spec, const Vector& count, const robot::Model& model)
    : eccentricity_(spec.eccentricity_rad),
      phase_(spec.eccentricity_phase_rad),
      count_(count),
      position_noise_(spec.noise_std_rad),
      velocity_noise_(spec.velocity_noise_std_rad_per_s),
      seed_(spec.seed) {
  for (Eigen::Index i = 0; i < eccentricity_.size(); ++i) {
    const bool slides =
        model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::prismatic;
    if (slides) eccentricity_[i] = 0;
  }
}

Vector Encoder::read(const Vector& exact, Channel channel, std::int64_t tick) const {
  const bool position = channel == Channel::link_position || channel == Channel::motor_position;
  const double noise = position ? position_noise_ : velocity_noise_;
  Vector measured = exact;
  for (Eigen::Index i = 0; i < exact.size(); ++i) {
    if (channel == Channel::link_position && eccentricity_.size() > 0 && eccentricity_[i] > 0) {
      measured[i] += eccentricity_[i] * base::sin(exact[i] + phase_[i]);
    }
    if (noise > 0) {
      measured[i] += noise * standard_normal(seed_, tick, static_cast<std::uint32_t>(channel),
                                             static_cast<std::uint32_t>(i));
    }
    if (position && count_[i] > 0) measured[i] = std::round(measured[i] / count_[i]) * count_[i];
  }
  return measured;
}

}  // namespace tachless::plant
