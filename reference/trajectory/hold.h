#pragma once

#include <string_view>

#include "loop/signals.h"
#include "schema/schema.h"

namespace tachless::reference::trajectory {

/// A constant position: all its derivatives are zero.
struct Hold {
  robot::Vector position_rad;  ///< [rad; m if prismatic]

  static constexpr std::string_view name = "hold";
  static constexpr std::tuple keys{
      schema::Key{"position_rad", &Hold::position_rad, "rad (m)", "Constant reference"}};

  /// The reference at any time.
  [[nodiscard]] loop::ReferencePoint at(double /*t_s*/) const {
    const robot::Vector zero = robot::Vector::Zero(position_rad.size());
    return {position_rad, zero, zero, zero, zero};
  }
};

}  // namespace tachless::reference::trajectory
