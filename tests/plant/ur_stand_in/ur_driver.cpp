#include "ur_client_library/ur/ur_driver.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "plant/plant_model.h"
#include "robot/dynamics.h"

namespace urcl {
namespace {

using tachless::Vector;

constexpr double tick_s = 2e-3;
constexpr int steps_a_tick = 20;

EmulatedArm* the_arm = nullptr;

EmulatedArm& connected(const UrDriverConfiguration& config) {
  if (the_arm == nullptr || !the_arm->is_there) {
    throw std::runtime_error("Failed to connect to " + config.robot_ip);
  }
  the_arm->on_program = config.handle_program_state;
  if (the_arm->program_starts) {
    the_arm->program_runs = true;
    the_arm->on_program(true);
  }
  return *the_arm;
}

}  // namespace

EmulatedArm::EmulatedArm(const tachless::scenario::Scenario& scenario)
    : model_(tachless::plant::plant_model(scenario)),
      next_(Vector::Zero(model_.num_joints)),
      acting_(next_) {
  viscous_scale.fill(0.9);
  coulomb_scale.fill(0.8);
  q = tachless::plant::initial_state(scenario.plant, scenario.robot.flexible, model_).q;
  v = Vector::Zero(model_.num_joints);
  model_.gravity.setZero();  // the arm adds it
  the_arm = this;
}

EmulatedArm::~EmulatedArm() { the_arm = nullptr; }

void EmulatedArm::tick() {
  time_s += tick_s;
  if (torque_mode_ && time_s - heard_s_ > timeout_s_ + tick_s / 2) end_program();
  for (int i = 0; i < steps_a_tick; ++i) {
    constexpr double step_s = tick_s / steps_a_tick, braking_s = 0.02;
    if (torque_mode_) {
      v += step_s * tachless::robot::forward_dynamics(model_, q, v, acting_);
    } else {
      v *= std::exp(-step_s / braking_s);  // stopj
    }
    q += step_s * v;
  }
  acting_ = next_;
}

void EmulatedArm::command(const vector6d_t& tau, std::chrono::milliseconds timeout) {
  torque_mode_ = true;
  ++torques_;
  if (torques_ == protective_stop_at) {
    safety = 3;
    end_program();
  }
  if (torques_ == program_ends_at) end_program();
  next_ = Eigen::Map<const Eigen::VectorXd>(tau.data(), 6);
  heard_s_ = time_s;
  timeout_s_ = 1e-3 * static_cast<double>(timeout.count());
}

void EmulatedArm::end_program() {
  torque_mode_ = false;
  if (!std::exchange(program_runs, false)) return;
  on_program(false);
}

VersionInformation VersionInformation::fromString(const std::string& text) {
  VersionInformation version;
  std::sscanf(text.c_str(), "%u.%u.%u", &version.major, &version.minor, &version.bugfix);
  return version;
}

namespace rtde_interface {

void DataPackage::require(const std::string& name) const {
  if (std::ranges::find(recipe_, name) == recipe_.end()) throw std::runtime_error("no " + name);
}

bool DataPackage::getData(const std::string& name, vector6d_t& value) const {
  require(name);
  const Vector& from = name == "actual_q" ? arm->q : arm->v;
  std::ranges::copy(from, value.begin());
  return true;
}

bool DataPackage::getData(const std::string& name, double& value) const {
  require(name);
  value = arm->time_s;
  return true;
}

bool DataPackage::getData(const std::string& name, std::int32_t& value) const {
  require(name);
  value = arm->safety;
  return true;
}

}  // namespace rtde_interface

UrDriver::UrDriver(const UrDriverConfiguration& config)
    : arm_(connected(config)), recipe_(config.output_recipe) {}

VersionInformation UrDriver::getVersion() const {
  return VersionInformation::fromString(arm_.version);
}

bool UrDriver::getDataPackage(rtde_interface::DataPackage& package) {
  if (arm_.is_silent()) return false;
  arm_.tick();
  package.arm = &arm_;
  return true;
}

bool UrDriver::writeJointCommand(const vector6d_t& values, comm::ControlMode mode,
                                 const RobotReceiveTimeout& timeout) {
  if (!arm_.program_runs || mode != comm::ControlMode::MODE_TORQUE) return false;
  arm_.command(values, timeout.timeout);
  return true;
}

bool UrDriver::setFrictionScales(const vector6d_t& viscous, const vector6d_t& coulomb) {
  if (!arm_.takes_friction_scales) return false;
  arm_.viscous_scale = viscous;
  arm_.coulomb_scale = coulomb;
  return true;
}

bool UrDriver::setTargetPayload(float mass, const vector3d_t& /*center*/) {
  arm_.payload_kg = mass;
  return true;
}

bool UrDriver::stopControl() {
  ++arm_.stops;
  const bool ran = arm_.program_runs;
  arm_.end_program();
  return ran;
}

}  // namespace urcl
