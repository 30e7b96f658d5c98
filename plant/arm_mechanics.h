#pragma once

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>

#include "plant/arm.h"
#include "robot/model.h"
#include "robot/quantities.h"

namespace tachless::plant {

/// (q, theta), or their rates: one vector of up to twice the joints, in place.
using Coordinates =
    Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 2 * robot::max_joints, 1>;

/// What an `Arm` delegates to: the plant's equations here, multibody code and integrator in one
/// heir for each choice of `Mechanics`. Relies on checked sizes and on a time that moves forward,
/// and reports a failure by its cause alone. C++17-clean for the Simbody translation unit.
class ArmMechanics {
 public:
  ArmMechanics(const ArmMechanics&) = delete;
  ArmMechanics& operator=(const ArmMechanics&) = delete;
  virtual ~ArmMechanics() = default;

  /// Moves the state on to `time_s` under the held torque.
  virtual void advance(double time_s) = 0;
  /// Of (q, theta) as it is now.
  virtual Coordinates acceleration();
  /// Steps that the integrator has taken since the start.
  [[nodiscard]] virtual std::int64_t steps() const = 0;

  void brake(const robot::Vector& damping) { (flexible_ ? motor_damping_ : friction_) += damping; }

  /// The right-hand side of the plant: the paper's eq. 1 (flexible) or eq. 2 (rigid) with friction
  /// and disturbances. Rotors of flexible joints are pinned to the ground (Spong's simplification),
  /// so each is a scalar equation.
  /// @param x, xdot, xddot (q, theta) at `time_s`, their rates and accelerations
  /// @throw std::runtime_error if the inertia matrix is not positive definite.
  void accelerate(double time_s, const double* x, const double* xdot, double* xddot);

  robot::Vector tau;    ///< motor torque, held
  Coordinates x, xdot;  ///< state
  double now_s;

 protected:
  /// @throw std::logic_error when a size is wrong.
  ArmMechanics(const robot::Model& model, const ArmOptions& options, const ArmState& initial);

  struct Links {
    robot::Matrix& M;           ///< inertia matrix without rotors; the lower triangle counts
    const robot::Vector& bias;  ///< C(q,v) v + g(q) [N m]
  };
  /// At link position q and velocity v.
  virtual Links evaluate(const double* q, const double* v) = 0;
  /// Torques at link velocity v become accelerations: rhs := M^-1 rhs; overwrites M.
  /// @throw std::runtime_error if M is not positive definite.
  virtual void solve(const double* v, robot::Vector& rhs) = 0;

  /// Steps of one `advance` beyond which it gives up.
  static constexpr int max_steps_per_advance = 20000;
  static std::runtime_error too_many_steps() {
    return std::runtime_error("more than " + std::to_string(max_steps_per_advance) +
                              " integrator steps");
  }

 private:
  bool flexible_;
  robot::Vector K_, J_, motor_damping_, rigid_rotor_inertia_, friction_, rhs_;
  const Disturbances* disturbances_;
};

std::unique_ptr<ArmMechanics> simbody_arm(const robot::Model& model, const ArmOptions& options,
                                          const ArmState& initial);
std::unique_ptr<ArmMechanics> native_arm(const robot::Model& model, const ArmOptions& options,
                                         const ArmState& initial);

}  // namespace tachless::plant
