#include "plant/arm.h"

#include <sstream>
#include <stdexcept>
#include <string>

#include "plant/arm_engine.h"

namespace tachless::plant {
namespace {

void require_size(const robot::Vector& x, int num_joints) {
  if (x.size() != num_joints) throw std::logic_error("plant::Arm: wrong number of joints");
}

/// Simbody's messages have several lines.
std::string cannot_go_on(double from_s, const std::string& cause) {
  std::istringstream words(cause);
  std::ostringstream message;
  message << "the plant cannot be integrated on from t = " << from_s << " s:";
  for (std::string word; words >> word;) message << ' ' << word;
  message << "; shorten loop.period_s, loosen plant.integrator.accuracy, or look for a torque, "
             "stiffness or speed that is out of proportion";
  return message.str();
}

}  // namespace

Arm::Arm(const robot::Model& model, const ArmOptions& options, const ArmState& initial) {
  const int num_motors = options.flexible != nullptr ? model.num_joints : 0;
  if (initial.q.size() != model.num_joints || initial.v.size() != model.num_joints ||
      initial.theta.size() != num_motors || initial.thetadot.size() != num_motors) {
    throw std::logic_error("plant::Arm: initial state has the wrong number of joints");
  }
  num_joints_ = model.num_joints;
  now_s_ = options.start_s;
  outside_ = options.outside;
  engine_ = options.mechanics == Mechanics::native ? native_arm(model, options, initial)
                                                   : simbody_arm(model, options, initial);
}
Arm::~Arm() = default;
Arm::Arm(Arm&&) noexcept = default;
Arm& Arm::operator=(Arm&&) noexcept = default;

const ArmState& Arm::state() const { return engine_->state(); }
std::int64_t Arm::integrator_steps() const { return engine_->integrator_steps(); }

ArmAcceleration Arm::acceleration(const robot::Vector& tau) const {
  require_size(tau, num_joints_);
  return engine_->acceleration(tau);
}

void Arm::advance(const robot::Vector& tau, double time_s) {
  require_size(tau, num_joints_);
  if (!(time_s > now_s_)) throw std::logic_error("plant::Arm: time must move forward");
  try {
    double piece_s = now_s_;
    for (double end_s = time_s; outside_ != nullptr && piece_s < time_s; piece_s = end_s) {
      end_s = outside_->next_jump(piece_s, time_s);
      outside_->choose(piece_s, end_s);
      engine_->advance(tau, end_s);
    }
    if (outside_ == nullptr) engine_->advance(tau, time_s);
    const ArmState& now = state();
    if (!(now.q.allFinite() && now.v.allFinite() && now.theta.allFinite() &&
          now.thetadot.allFinite())) {
      throw std::runtime_error("the state is not finite");
    }
  } catch (const std::logic_error&) {
    throw;
  } catch (const std::exception& error) {
    throw std::runtime_error(cannot_go_on(now_s_, error.what()));
  }
  now_s_ = time_s;
}

void Arm::brake(const robot::Vector& damping) {
  require_size(damping, num_joints_);
  engine_->brake(damping);
}

}  // namespace tachless::plant
