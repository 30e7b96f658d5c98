#pragma once

#include <concepts>
#include <utility>

#include "robot/quantities.h"

namespace tachless::controller::law {

/// From what a law's rule of thumb for its gains starts: two poles at the bandwidth w for each
/// joint taken alone. A law that has one declares `static Gains tuned(const Tuning&)`. The rule
/// looks at no margin: `design` does (certificate/design.h).
struct Tuning {
  double w = 0;             ///< bandwidth [rad/s]
  double damping = 1;       ///< of the two poles
  double filter = 0;        ///< pole of filters and observers [1/s]
  double period_s = 1e-3;   ///< h [s]
  robot::Vector inertia;    ///< what each joint feels [kg m2]
  robot::Vector stiffness;  ///< K [N m/rad]; empty for rigid joints
  robot::Vector rotor;      ///< J [kg m2]; empty for rigid joints

  [[nodiscard]] robot::Vector kp() const { return w * w * inertia; }
  [[nodiscard]] robot::Vector kd() const { return 2 * (damping * w) * inertia; }
  /// Gains of a motor's position and velocity that move its link through the spring: links and
  /// rotors as one, no faster than a quarter of the link's resonance on its spring.
  [[nodiscard]] std::pair<robot::Vector, robot::Vector> through_spring() const {
    const robot::Vector felt = inertia + rotor;
    const robot::Vector slower = (0.25 * stiffness.cwiseQuotient(inertia).cwiseSqrt()).cwiseMin(w);
    return {slower.cwiseAbs2().cwiseProduct(felt), 2 * damping * slower.cwiseProduct(felt)};
  }
  [[nodiscard]] robot::Vector each(double value) const {
    return value * robot::Vector::Ones(inertia.size());
  }
  /// Of the motors behind their springs, links held: sqrt(K / J) [rad/s].
  [[nodiscard]] robot::Vector resonance() const {
    return stiffness.cwiseQuotient(rotor).cwiseSqrt();
  }
  /// Damps the resonance by a quarter of critical [N m s/rad].
  [[nodiscard]] robot::Vector motor_kd() const { return 0.5 * rotor.cwiseProduct(resonance()); }
};

template <class L>
concept Tuned = requires(const Tuning& tuning) {
  { L::tuned(tuning) } -> std::same_as<typename L::Gains>;
};

}  // namespace tachless::controller::law
