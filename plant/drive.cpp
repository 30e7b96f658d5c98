#include "plant/drive.h"

#include <cmath>
#include <stdexcept>

namespace tachless::plant {

Drive::Drive(const robot::Vector& limit, int command_delay, const robot::Vector& change)
    : limit_(limit), change_(change), num_slots_(static_cast<std::size_t>(command_delay) + 1) {
  if (command_delay < 0 || command_delay > max_delay_ticks) {
    throw std::logic_error("plant::Drive: command_delay is out of range");
  }
  if (!(limit.array() > 0).all() || !(change.array() > 0).all()) {
    throw std::logic_error("plant::Drive: torque limits must be positive");
  }
  applied_.tau = before_ = robot::Vector::Zero(limit.size());
  accepted_.fill(applied_);
}

bool Drive::accept(const loop::TorqueCommand& command) {
  if (command.tau.size() != limit_.size()) {
    throw std::logic_error("plant::Drive: command has the wrong number of joints");
  }
  if (!command.tau.allFinite()) return false;
  if (stopped_) return true;
  for (Eigen::Index i = 0; i < limit_.size(); ++i) {
    const double tau = command.tau[i];
    const bool saturated = std::abs(tau) > limit_[i];
    accepted_[now_].saturated[static_cast<std::size_t>(i)] = saturated;
    accepted_[now_].tau[i] = saturated ? std::copysign(limit_[i], tau) : tau;
  }
  act();
  return true;
}

void Drive::end_tick() {
  const std::size_t last = now_;
  now_ = (now_ + 1) % num_slots_;
  accepted_[now_] = accepted_[last];
  before_ = applied_.tau;
  act();
}

void Drive::act() {
  applied_ = accepted_[(now_ + 1) % num_slots_];
  for (Eigen::Index i = 0; i < change_.size(); ++i) {
    const double wanted = applied_.tau[i] - before_[i];
    if (std::abs(wanted) <= change_[i]) continue;
    applied_.tau[i] = before_[i] + std::copysign(change_[i], wanted);
    applied_.saturated[static_cast<std::size_t>(i)] = true;
  }
}

void Drive::stop() {
  stopped_ = true;
  applied_.tau.setZero();
  applied_.saturated = {};
  before_.setZero();
  accepted_.fill(applied_);
}

}  // namespace tachless::plant
