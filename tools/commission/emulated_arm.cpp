#include "commission/emulated_arm.h"

#include <utility>

#include "base/failure.h"
#include "in_process/in_process_loop.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"

namespace tachless::commission {

EmulatedArm::EmulatedArm(scenario::Scenario scenario)
    : scenario_(std::move(scenario)),
      model_(plant::plant_model(scenario_)),
      own_torque_(scenario_),
      encoder_(scenario_.plant.encoder, scenario::encoder_count(scenario_, model_), model_),
      now_(plant::initial_state(scenario_.plant, scenario_.robot.flexible, model_)) {}

void EmulatedArm::start() {
  const Vector gravity = robot::gravity_torque(model_, now_.q);
  now_.v.setZero();
  now_.thetadot.setZero();
  if (scenario_.robot.flexible) {  // the links hang at rest on their springs
    now_.theta = now_.q + gravity.cwiseQuotient(scenario_.robot.flexible->stiffness);
  }
  if (now_.torque.size() > 0) now_.torque = gravity;
  arm_.emplace(plant::make_arm(scenario_.plant, scenario_.robot.flexible, model_, now_));
  last_ = Vector::Zero(model_.num_joints);
  past_.assign(static_cast<std::size_t>(scenario_.plant.encoder.latency_ticks), now_);
}

plant::ArmState EmulatedArm::read() {
  plant::ArmState seen = now_;
  if (arm_) {
    past_.push_back(now_);
    seen = past_.front();
    past_.pop_front();
  }
  const scenario::RobotSpec& robot = scenario_.robot;
  seen.time_s = static_cast<double>(readings_) * scenario_.loop.period_s;
  seen.q = encoder_.measure<messages::PositionMeasurement>(seen, readings_++).q;
  seen.q = robot.joint_signs.cwiseProduct(seen.q - robot.joint_offsets_rad);
  seen.v = robot.joint_signs.cwiseProduct(seen.v);
  return seen;
}

void EmulatedArm::hold(const Vector& tau, double until_s) {
  last_ = tau;
  Vector acts = scenario_.robot.joint_signs.cwiseProduct(tau);
  if (own_torque_.any()) acts += own_torque_.at(now_.q, now_.v);
  arm_->advance(acts, until_s);
  now_ = arm_->state();
}

Trials trials_on(plant::RobotDriver& arm) {
  return [&arm](const scenario::Scenario& scenario, const std::vector<std::string>& /*by*/) {
    Trial result{Eigen::MatrixXd(scenario.loop.num_ticks, scenario.num_joints),
                 Eigen::MatrixXd(scenario.loop.num_ticks, scenario.num_joints)};
    result.arm_is_clock = arm.is_clock();
    Eigen::Index ticks = 0;
    try {
      in_process::run_in_process(
          scenario, controller::scenario_law(scenario),
          [&](const in_process::TickRecord& tick) {
            result.q.row(ticks) =
                std::get<messages::PositionMeasurement>(tick.measurement).q.transpose();
            result.tau.row(ticks++) = tick.applied.tau.transpose();
            return true;
          },
          &arm);
    } catch (const base::Failure& failure) {
      if (failure.code() != base::ExitCode::protective_stop) throw;
      result.stopped = failure.what();
    }
    result.q.conservativeResize(ticks, Eigen::NoChange);
    result.tau.conservativeResize(ticks, Eigen::NoChange);
    return result;
  };
}

}  // namespace tachless::commission
