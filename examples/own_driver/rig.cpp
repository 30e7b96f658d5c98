#include "rig.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <tachless/robot/dynamics.h>

namespace tachless::own_driver {

constexpr double step_s = 1e-4, brake_time_constant_s = 0.02;
constexpr double count = 2 * std::numbers::pi / (1 << 20);

Rig::Rig(const robot::Model& model)
    : model_(model), q_(Vector::Zero(model.num_joints)), v_(q_), tau_(q_), now_(Clock::now()) {}

void Rig::move_on() {
  const auto until = Clock::now();
  while (now_ < until) {
    const double h = std::min(step_s, std::chrono::duration<double>(until - now_).count());
    if (enabled_ && now_ - written_ > watchdog) {
      tripped_ = true;
      brake();
    }
    if (enabled_) {
      v_ += h * robot::forward_dynamics(model_, q_, v_, tau_);
    } else {
      v_ *= std::exp(-h / brake_time_constant_s);
    }
    q_ += h * v_;
    now_ += std::max(Clock::duration(1),
                     std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(h)));
  }
}

Vector Rig::read_encoders() {
  move_on();
  return (q_ / count).array().round() * count;
}

void Rig::enable() {
  move_on();
  enabled_ = true;
  written_ = now_;
}

void Rig::write_torque(const Vector& tau) {
  move_on();
  tau_ = tau;
  written_ = now_;
}

void Rig::brake() {
  enabled_ = false;
  tau_.setZero();
}

bool Rig::watchdog_has_tripped() {
  move_on();
  return tripped_;
}

}  // namespace tachless::own_driver
