#pragma once

#include "robot/signals.h"

namespace reference::trajectory {

/// A constant position: everything above it is zero.
struct Hold {
  robot::Vector position;  ///< [rad; m if prismatic]

  /// The reference at any time.
  [[nodiscard]] robot::ReferencePoint at(double t_s) const;
};

inline robot::ReferencePoint Hold::at(double /*t_s*/) const {
  const robot::Vector zero = robot::Vector::Zero(position.size());
  return {position, zero, zero, zero, zero};
}

}  // namespace reference::trajectory
