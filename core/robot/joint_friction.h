#pragma once

#include <cmath>

#include "base/elementary.h"

namespace tachless::robot {

/// Returns the rise of friction with speed, F_r tanh(v / v_r) [N m; N]. A negative F_r is a fall.
inline double friction_rise(double v, double rise, double rise_velocity) {
  return rise == 0 ? 0 : rise * base::tanh(v / rise_velocity);
}

/// The law of a joint's dry friction at velocity v, under gravity's torque g:
///
///   F = sign(v) (Fc + c |g| + (Fs - Fc) exp(-(v/vs)^2)) + Fr tanh(v / vr) for v != 0,
///   |F| <= Fs + c |g| at rest.
///
/// It gives no energy if Fs >= Fc >= 0, c >= 0 and Fr >= -Fc.
struct JointFriction {
  double coulomb = 0;        ///< Fc [N m; N]
  double held = 0;           ///< Fs [N m; N]
  double stribeck = 1;       ///< vs [rad/s; m/s]
  double rise = 0;           ///< Fr [N m; N]
  double rise_velocity = 1;  ///< vr [rad/s; m/s]
  double load = 0;           ///< c

  [[nodiscard]] bool is_possible() const {
    return coulomb >= 0 && held >= coulomb && stribeck > 0 && rise >= -coulomb &&
           rise_velocity > 0 && (load == 0 || (load > 0 && held > 0));
  }
  /// Returns the largest friction at rest.
  [[nodiscard]] double holding(double gravity) const { return held + load * std::abs(gravity); }
  /// Returns the friction at v without the fall from static friction, far above vs; 0 at v = 0.
  [[nodiscard]] double kinetic(double v, double gravity) const {
    if (v == 0) return 0;
    const double dry = std::copysign(coulomb + load * std::abs(gravity), v);
    return rise == 0 ? dry : dry + friction_rise(v, rise, rise_velocity);
  }
  /// Returns the friction of a joint that moves at v.
  /// @param direction sign of the velocity, also where v is zero at the moment
  [[nodiscard]] double sliding(double v, int direction, double gravity) const {
    const double x = v / stribeck;
    const double dry =
        direction * (coulomb + load * std::abs(gravity) + (held - coulomb) * base::exp(-x * x));
    return rise == 0 ? dry : dry + friction_rise(v, rise, rise_velocity);
  }
};

}  // namespace tachless::robot
