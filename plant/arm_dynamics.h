#pragma once

#include <stdexcept>
#include <utility>

#include "plant/arm.h"
#include "robot/model.h"
#include "robot/quantities.h"

namespace tachless::plant {

/// The right-hand side of the plant: the paper's eq. 1 (flexible) or eq. 2 (rigid) with viscous
/// friction and outside torques. Rotors of flexible joints are pinned to the ground (Spong's
/// simplification), so each is a scalar equation. Does not integrate, and is C++17-clean for the
/// Simbody file.
///
/// `Multibody` gives the links' inertia matrix and bias:
///   void evaluate(const double* q, const double* v);
///   robot::Matrix& M();                            // lower triangle, without rotors
///   const robot::Vector& bias() const;             // C(q,v) v + g(q) [N m]
///   void solve(robot::Vector& rhs);                // rhs := M^-1 rhs; throws std::runtime_error
template <class Multibody>
class ArmDynamics {
 public:
  ArmDynamics(const robot::Model& model, const ArmOptions& options)
      : num_joints_(model.num_joints), flexible_(options.flexible != nullptr), links_(model) {
    const robot::Vector zero = robot::Vector::Zero(num_joints_);
    const auto or_zero = [&](const robot::Vector& x) { return x.size() == 0 ? zero : x; };
    if (flexible_) {
      K_ = options.flexible->stiffness;
      J_ = options.flexible->rotor_inertia;
      motor_damping_ = or_zero(options.flexible->motor_damping);
    }
    outside_ = options.outside;
    rigid_rotor_inertia_ = or_zero(model.rotor_inertia);
    friction_ = or_zero(options.viscous_friction);
    for (const robot::Vector* x : {&friction_, &rigid_rotor_inertia_}) {
      if (x->size() != num_joints_) throw std::logic_error("plant::Arm: wrong number of joints");
    }
    if (flexible_ && (K_.size() != num_joints_ || J_.size() != num_joints_ ||
                      motor_damping_.size() != num_joints_ || !(J_.array() > 0).all())) {
      throw std::logic_error("plant::Arm: flexible joints need K, J > 0 and damping per joint");
    }
    tau = zero;
  }

  [[nodiscard]] int num_joints() const { return num_joints_; }
  [[nodiscard]] int num_motors() const { return flexible_ ? num_joints_ : 0; }
  [[nodiscard]] int num_coordinates() const { return num_joints_ + num_motors(); }

  void brake(const robot::Vector& damping) { (flexible_ ? motor_damping_ : friction_) += damping; }

  Multibody& links() { return links_; }

  /// Accelerations of (q, theta) at a time, positions x = (q, theta) and rates xdot, each
  /// `num_coordinates` long.
  /// @throw std::runtime_error if the inertia matrix is not positive definite.
  void accelerate(double time_s, const double* x, const double* xdot, double* xddot) {
    const int n = num_joints_;
    links_.evaluate(x, xdot);
    rhs_ = -links_.bias();
    for (int i = 0; i < n; ++i) {
      links_.M()(i, i) += rigid_rotor_inertia_[i];
      rhs_[i] -= friction_[i] * xdot[i];
      if (flexible_) {
        const double spring = K_[i] * (x[n + i] - x[i]);
        rhs_[i] += spring;
        xddot[n + i] = (tau[i] - spring - motor_damping_[i] * xdot[n + i]) / J_[i];
      } else {
        rhs_[i] += tau[i];
      }
    }
    if (outside_ != nullptr) outside_->add(time_s, x, rhs_);
    links_.solve(rhs_);
    for (int i = 0; i < n; ++i) xddot[i] = rhs_[i];
  }

  robot::Vector tau;  ///< motor torque, held

 private:
  int num_joints_;
  bool flexible_;
  Multibody links_;
  robot::Vector K_, J_, motor_damping_, rigid_rotor_inertia_, friction_;
  robot::Vector rhs_;
  const OutsideTorque* outside_ = nullptr;
};

}  // namespace tachless::plant
