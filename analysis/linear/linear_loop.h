#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "controller/law/law.h"
#include "messages/measurements.h"
#include "messages/signals.h"
#include "robot/model.h"

/// The closed loop linearised about a reference: a plant in continuous time, a law in discrete
/// time, and the map of one period that they make with the torque held.
namespace tachless::linear {

using messages::Part;

/// Returns where `is` ends between `inside`, where it holds, and `outside`, by bisection. `is`
/// holds at the returned value.
template <class Inside>
double edge(double inside, double outside, int halvings, const Inside& is) {
  for (; halvings > 0; --halvings) {
    const double middle = (inside + outside) / 2;
    (is(middle) ? inside : outside) = middle;
  }
  return inside;
}

/// Returns the largest whole number from `inside`, where `is` holds, to `most`, if `is` holds up to
/// some number and then not. Steps are doubled, then halved.
template <class Inside>
int largest_whole(int inside, int most, const Inside& is) {
  int step = 1;
  while (inside + step <= most && is(inside + step)) {
    inside += step;
    step *= 2;
  }
  for (; step >= 1; step /= 2) {
    if (inside + step <= most && is(inside + step)) inside += step;
  }
  return inside;
}

/// Returns base^exponent. Precondition: 0 <= exponent.
Eigen::MatrixXd power(Eigen::MatrixXd base, std::int64_t exponent);

/// Loop inside the drives, as part of a plant. At the beginning of each of its ticks x <- jump x;
/// in between A holds its states. They follow the arm's: q less its value at the last tick, the
/// drive's velocity, the torque that acts, those under way, and last the host's torque in use.
struct DriveTicks {
  double period_s = 0;
  Eigen::MatrixXd jump;
  Eigen::Index arm_states = 0;
  /// Share of the host's period after which the drives use a torque, in [0, 1).
  double late = 0;

  /// First row of the torque that acts on the arm.
  [[nodiscard]] Eigen::Index acting(Eigen::Index num_joints) const {
    return arm_states + 2 * num_joints;
  }
};

/// xdot = A x + B tau in deviations x = (q, v) from the reference, (q, v, theta, thetadot) with
/// flexible joints; torques of current loops that lag come after these. With a loop inside the
/// drives B tau is the host's torque in use.
struct LinearPlant {
  Eigen::MatrixXd A, B;
  Eigen::Index num_joints = 0;
  std::optional<DriveTicks> drive = {};

  /// Number of states without those of a loop inside the drives.
  [[nodiscard]] Eigen::Index arm_states() const { return drive ? drive->arm_states : A.rows(); }
};

/// At rest in `q`.
messages::ReferencePoint constant_reference(const Vector& q);

/// The gradient of inverse dynamics M(q) a + C(q, v) v + g(q) by q, at a point of a motion
/// [N m/rad].
Eigen::MatrixXd gradient_by_q(const robot::Model& model, const messages::ReferencePoint& point);

/// M eddot + 2 C(q, v) edot + gradient_by_q e = tau. `friction` [N m s/rad] is viscous, at the
/// joints, in addition; empty: none.
LinearPlant rigid_plant(const robot::Model& model, const messages::ReferencePoint& point,
                        const Eigen::VectorXd& friction = {});
/// The links' motion is `point`; springs and rotors are linear anyway. `friction` is the motors'.
LinearPlant flexible_plant(const robot::Model& links, const messages::ReferencePoint& point,
                           const Eigen::VectorXd& stiffness, const Eigen::VectorXd& rotor_inertia,
                           const Eigen::VectorXd& friction = {});

/// memory' = A memory + B y, tau = C memory + D y, where y stacks the measured parts of the plant.
struct LinearLaw {
  Eigen::MatrixXd A, B, C, D;
  std::vector<Part> measured;
  /// The part of D that compensates gravity by the model: no gain of the feedback. Empty: none.
  Eigen::MatrixXd compensation = {};
  /// The memory that it begins a run with, by its first measurement. Empty: not known.
  Eigen::MatrixXd start = {};
};

/// Returns C of y = C x, the measurement of a law. The vector x has so many states, the plant's
/// first.
Eigen::MatrixXd measured_rows(const std::vector<Part>& measured, Eigen::Index num_joints,
                              Eigen::Index states);

/// The memory of a run that begins with these deviations of the measurement, each in a column:
/// where `start` is not known that after long, of a law that forgets, else 0.
Eigen::MatrixXd first_memory(const LinearLaw& law, const Eigen::MatrixXd& measured);

/// The gradient of a law by central differences of step `step` times max(1, |x_i|).
LinearLaw linearised(const controller::law::LawStep& law, const Eigen::VectorXd& memory,
                     const Eigen::VectorXd& measurement, std::vector<Part> measured,
                     double step = 1e-6);

/// The plant over one period with its torque held, exactly: x' = A x + B tau. A loop inside the
/// drives ticks as often as its period is nearest to; its ticks are stretched to fit.
LinearPlant held(const LinearPlant& plant, double period_s);

/// One period of (x, memory, torques under way) with the law's feedback terms cut: the torque
/// computed at tick k acts from tick k + delay on, the compensation of gravity stays closed, and
/// the feedback terms C state enter through B.
struct CutLoop {
  Eigen::MatrixXd A, B, C;

  /// The map of one period when it is closed again; `gain` multiplies the feedback terms.
  [[nodiscard]] Eigen::MatrixXd closed(double gain = 1) const;
};
CutLoop cut(const LinearPlant& plant, const LinearLaw& law, double period_s, int delay);

}  // namespace tachless::linear
