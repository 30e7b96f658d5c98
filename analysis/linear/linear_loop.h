#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "controller/law/law.h"
#include "messages/measurements.h"
#include "messages/signals.h"
#include "robot/model.h"

/// The closed loop linearised about a reference. A plant in continuous time and a law in discrete
/// time make a map of one period with the torque held.
namespace tachless::linear {

using messages::Part;

/// The number between two limits at which a search looks next.
enum class Middle { arithmetic, geometric };

/// Returns the limit of a condition by bisection. The condition `is` holds at `inside` and at the
/// result. It does not hold at `outside`.
/// @param middle geometric: each step halves the logarithm of the ratio of both ends
template <class Inside>
double edge(double inside, double outside, int halvings, const Inside& is,
            Middle middle = Middle::arithmetic) {
  for (; halvings > 0; --halvings) {
    const double between =
        middle == Middle::geometric ? std::sqrt(inside * outside) : (inside + outside) / 2;
    (is(between) ? inside : outside) = between;
  }
  return inside;
}

/// Returns the largest whole number up to `most` at which `is` holds. Precondition: `is` holds from
/// `inside` up to one number, and at no larger number. Steps are doubled, then halved.
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

/// Loop inside the drives, as part of a plant. At the beginning of each tick of the drives the
/// plant's state x becomes jump x. Between ticks A keeps the states of the drives constant. In x
/// the states of the drives follow the arm's states: q less q at the last tick, the drives'
/// velocity, the torque that acts, the computed torques that do not act yet, and the host's torque
/// in use.
struct DriveTicks {
  double period_s = 0;          ///< one tick of the drives [s]
  Eigen::MatrixXd jump;         ///< square, of the size of x
  Eigen::Index arm_states = 0;  ///< number of states before those of the drives
  /// Share of the host's period after which the drives use a torque, in [0, 1).
  double late = 0;

  /// Returns the first row of the torque that acts on the arm.
  [[nodiscard]] Eigen::Index acting(Eigen::Index num_joints) const {
    return arm_states + 2 * num_joints;
  }
};

/// A plant xdot = A x + B tau in deviations x from the reference: (q, v), with flexible joints (q,
/// v, theta, thetadot). Torques of current loops that lag come last. With a loop inside the drives
/// B writes tau into the state "the host's torque in use" (DriveTicks).
struct LinearPlant {
  Eigen::MatrixXd A, B;
  Eigen::Index num_joints = 0;
  std::optional<DriveTicks> drive = {};

  /// Returns the number of states without the states of a loop inside the drives.
  [[nodiscard]] Eigen::Index arm_states() const { return drive ? drive->arm_states : A.rows(); }
};

/// Returns the reference at rest in `q`.
messages::ReferencePoint constant_reference(const Vector& q);

/// Returns the gradient of inverse dynamics M(q) a + C(q, v) v + g(q) by q, at a point of a motion
/// [N m/rad].
Eigen::MatrixXd gradient_by_q(const robot::Model& model, const messages::ReferencePoint& point);

/// Returns the plant M eddot + 2 C(q, v) edot + gradient_by_q e = tau. `friction` [N m s/rad] is
/// further viscous friction at the joints; empty: none.
LinearPlant rigid_plant(const robot::Model& model, const messages::ReferencePoint& point,
                        const Eigen::VectorXd& friction = {});
/// Returns the plant with flexible joints whose links move along `point`. Springs and rotors are
/// linear. `friction` is the friction of the motors, `spring_damping` acts between motors and links
/// [N m s/rad]; empty: none.
LinearPlant flexible_plant(const robot::Model& links, const messages::ReferencePoint& point,
                           const Eigen::VectorXd& stiffness, const Eigen::VectorXd& rotor_inertia,
                           const Eigen::VectorXd& friction = {},
                           const Eigen::VectorXd& spring_damping = {});

/// Returns states of a plant at rest, a column for each joint. In each column one joint and its
/// rotor are displaced by 1 [rad; m].
/// @param states length of a column; the entries after the arm's states are 0
Eigen::MatrixXd displaced(const LinearPlant& plant, Eigen::Index states);

/// A law memory' = A memory + B y, tau = C memory + D y, where y stacks the measured parts of the
/// plant.
struct LinearLaw {
  Eigen::MatrixXd A, B, C, D;
  std::vector<Part> measured;
  /// The part of D that compensates gravity by the model. No gain of the feedback changes it.
  /// Empty: none.
  Eigen::MatrixXd compensation = {};
  /// Map from the first measurement to the memory with which a run begins. Empty: not known.
  Eigen::MatrixXd start = {};
};

/// Returns C of y = C x, the measurement of a law.
/// @param states length of x, whose first states are the plant's
Eigen::MatrixXd measured_rows(const std::vector<Part>& measured, Eigen::Index num_joints,
                              Eigen::Index states);

/// Returns the memory of a run that begins with these deviations of the measurement, each in a
/// column. If `start` is not known, returns the memory at rest under these measurements, or 0 if
/// that is not unique.
Eigen::MatrixXd first_memory(const LinearLaw& law, const Eigen::MatrixXd& measured);

/// Returns the gradient of a law by central differences of step `step` times max(1, |x_i|).
LinearLaw linearised(const controller::law::LawStep& law, const Eigen::VectorXd& memory,
                     const Eigen::VectorXd& measurement, std::vector<Part> measured,
                     double step = 1e-6);

/// Returns the plant over one period with its torque held, exactly: x' = A x + B tau. A loop inside
/// the drives gets the nearest whole number of ticks, and its ticks are stretched to fit.
LinearPlant held(const LinearPlant& plant, double period_s);

/// Sets the rows of a map of one period of (x, memory, commanded torques that do not act yet) below
/// the rows of x. The row of the newest torque is 0.
/// @param measured rows of the plant's states x, as `measured_rows` returns them
void set_law_rows(const LinearLaw& law, const Eigen::MatrixXd& measured, Eigen::Index delay,
                  Eigen::MatrixXd& map);

/// One period of (x, memory, commanded torques that do not act yet) with the law's feedback terms
/// cut. The torque computed at tick k acts from tick k + delay on. The compensation of gravity
/// stays closed. The feedback terms C state enter through B.
struct CutLoop {
  Eigen::MatrixXd A, B, C;

  /// Returns the map of one period of the closed loop; `gain` multiplies the feedback terms.
  [[nodiscard]] Eigen::MatrixXd closed(double gain = 1) const;
};
/// Returns the loop of a plant and a law, cut, with `delay` periods from measurement to torque.
CutLoop cut(const LinearPlant& plant, const LinearLaw& law, double period_s, int delay);

}  // namespace tachless::linear
