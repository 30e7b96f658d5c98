#pragma once

#include <algorithm>
#include <cmath>

#include <tachless/plant/simulator.h>
#include <tachless/robot/dynamics.h>
#include <tachless/robot/kinematics.h>

namespace own_simulator {

using namespace tachless;
constexpr double longest_step_s = 1e-4, wall_m = 0.3, stiffness_N_per_m = 2e4,
                 damping_Ns_per_m = 200;

/// An arm beside a wall, which pushes the tip back like a spring with damping. Semi-implicit Euler
/// steps move the arm.
class ArmAtAWall final : public plant::Simulator {
 public:
  explicit ArmAtAWall(const robot::Model& model)
      : model_(model), tip_(model.frames.at("tip")), braking_(Vector::Zero(model.num_joints)) {}

  void reset(const plant::ArmState& initial) override {
    q_ = initial.q, v_ = initial.v;
    braking_.setZero(), now_s_ = 0;
  }

  plant::ArmState state() override { return {q_, v_, {}, {}, contact()}; }

  void advance(const Vector& tau, double until_s) override {
    const double whole_s = until_s - now_s_;
    const double steps = std::ceil(whole_s / longest_step_s - 1e-9), h = whole_s / steps;
    for (double k = 0; k < steps; ++k) {
      const Vector torque = tau + contact() - braking_.cwiseProduct(v_);
      v_ += h * robot::forward_dynamics(model_, q_, v_, torque);
      q_ += h * v_;
    }
    now_s_ = until_s;
  }

  void brake(const Vector& damping) override { braking_ = damping; }

 private:
  /// Returns the torques of the wall at x = `wall_m`; zero without contact.
  [[nodiscard]] Vector contact() const {
    constexpr double h = 1e-6;
    const double x = robot::frame_pose(model_, tip_, q_).p.x();
    const double speed = (robot::frame_pose(model_, tip_, q_ + h * v_).p.x() - x) / h;
    if (x <= wall_m) return Vector::Zero(model_.num_joints);
    const double push = stiffness_N_per_m * (x - wall_m) + damping_Ns_per_m * speed;
    return robot::force_torque(model_, tip_, {0, 0, 0}, {-std::max(push, 0.0), 0, 0}, q_);
  }

  robot::Model model_;
  robot::Frame tip_;
  Vector q_, v_, braking_;
  double now_s_ = 0;
};

}  // namespace own_simulator
