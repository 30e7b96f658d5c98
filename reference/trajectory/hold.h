#pragma once

#include "loop/signals.h"

namespace tachless::reference::trajectory {

/// A constant position: everything above it is zero.
struct Hold {
  robot::Vector position;  ///< [rad; m if prismatic]

  /// The reference at any time.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const;
};

inline loop::ReferencePoint Hold::at(double /*t_s*/) const {
  const robot::Vector zero = robot::Vector::Zero(position.size());
  return {position, zero, zero, zero, zero};
}

}  // namespace tachless::reference::trajectory
