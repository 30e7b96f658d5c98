#pragma once

#include "robot/model.h"
#include "robot/quantities.h"

namespace tachless::controller::law {

/// What a law knows of a robot with motors behind springs (paper, eq. 1; Spong's simplified
/// model): M_l(q) vdot + C(q,v) v + g(q) = K (theta - q), J thetaddot + K (theta - q) = tau.
/// Motor damping is not in eq. 1, hence not here.
struct FlexibleRobot {
  robot::Model links;           ///< link side: M_l, without rotor inertia
  robot::Vector stiffness;      ///< K [N m/rad], > 0
  robot::Vector rotor_inertia;  ///< J [kg m2], on the link side of the gear, > 0

  /// K (theta - q), the torque of the springs on the links [N m].
  [[nodiscard]] robot::Vector spring_torque(const robot::Vector& q,
                                            const robot::Vector& theta) const {
    return stiffness.cwiseProduct(theta - q);
  }
};

}  // namespace tachless::controller::law
