#include "plant/drive.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "plant/encoder.h"

namespace tachless::plant {

Drive::Drive(const DriveSpec& spec, int command_delay, double period_s, const Vector& initial)
    : limit_(spec.torque_limit_Nm.value_or(Vector(Vector::Constant(initial.size(), infinity)))),
      num_slots_(static_cast<std::size_t>(command_delay + spec.command_age_jitter_ticks) + 1),
      jitter_(spec.command_age_jitter_ticks),
      seed_(spec.seed) {
  if (spec.torque_rate_limit_Nm_per_s) change_ = *spec.torque_rate_limit_Nm_per_s * period_s;
  if (std::min(command_delay, jitter_) < 0 || std::max(command_delay, jitter_) > max_delay_ticks) {
    throw std::logic_error("plant::Drive: command_delay is out of range");
  }
  if (!(limit_.array() > 0).all() || !(change_.array() > 0).all()) {
    throw std::logic_error("plant::Drive: torque limits must be positive");
  }
  applied_.tau = initial.cwiseMin(limit_).cwiseMax(-limit_);
  initial_ = before_ = applied_.tau;
  added_ = Vector::Zero(limit_.size());
  accepted_.fill(applied_);
}

void Drive::accept(const messages::TorqueCommand& command) {
  if (command.tau.size() != limit_.size() || !command.tau.allFinite()) {
    throw std::logic_error("plant::Drive: a command needs a finite torque of each joint");
  }
  if (stopped_) return;
  for (Eigen::Index i = 0; i < limit_.size(); ++i) {
    const double tau = command.tau[i];
    const bool saturated = std::abs(tau) > limit_[i];
    accepted_[now_].saturated[static_cast<std::size_t>(i)] = saturated;
    accepted_[now_].tau[i] = saturated ? std::copysign(limit_[i], tau) : tau;
  }
  act();
}

void Drive::set_added(const Vector& added) {
  if (stopped_) return;
  added_ = added;
  if (tick_ == 0) before_ = initial_ - added_;
  act();
}

void Drive::end_tick() {
  shift();
  before_ = sent();
  ++tick_;
  act();
}

void Drive::skip(std::int64_t ticks) {
  const auto shifts = std::min(ticks, static_cast<std::int64_t>(num_slots_));
  for (std::int64_t i = 0; i < shifts; ++i) shift();
  tick_ += ticks;
  act();
}

void Drive::stop() {
  stopped_ = true;
  applied_.tau.setZero();
  applied_.saturated = {};
  before_.setZero();
  added_.setZero();
  accepted_.fill(applied_);
}

void Drive::shift() {
  const std::size_t last = now_;
  now_ = (now_ + 1) % num_slots_;
  accepted_[now_] = accepted_[last];
}

void Drive::act() {
  // The oldest slot was accepted command_delay + jitter ticks ago.
  const auto younger =
      jitter_ == 0 ? 0 : static_cast<std::size_t>((jitter_ + 1) * standard_uniform(seed_, tick_));
  applied_ = accepted_[(now_ + 1 + younger) % num_slots_];
  for (Eigen::Index i = 0; i < change_.size(); ++i) {
    const double wanted = applied_.tau[i] - added_[i] - before_[i];
    if (std::abs(wanted) <= change_[i]) continue;
    applied_.tau[i] = before_[i] + std::copysign(change_[i], wanted) + added_[i];
    applied_.saturated[static_cast<std::size_t>(i)] = true;
  }
}

}  // namespace tachless::plant
