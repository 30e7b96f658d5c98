#include "plant/drive.h"

#include <cmath>
#include <stdexcept>

namespace tachless::plant {

Drive::Drive(const robot::Vector& limit, int command_delay)
    : limit_(limit), command_delay_(command_delay) {
  if (command_delay != 0 && command_delay != 1) {
    throw std::logic_error("plant::Drive: command_delay must be 0 or 1");
  }
  if (!(limit.array() > 0).all()) {
    throw std::logic_error("plant::Drive: torque limits must be positive");
  }
  applied_.tau = robot::Vector::Zero(limit.size());
  accepted_ = applied_;
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
    accepted_.saturated[static_cast<std::size_t>(i)] = saturated;
    accepted_.tau[i] = saturated ? std::copysign(limit_[i], tau) : tau;
  }
  if (command_delay_ == 0) applied_ = accepted_;
  return true;
}

void Drive::end_tick() { applied_ = accepted_; }

void Drive::stop() {
  stopped_ = true;
  applied_.tau.setZero();
  applied_.saturated = {};
  accepted_ = applied_;
}

}  // namespace tachless::plant
