#pragma once

#include <string_view>

#include "base/schema.h"
#include "messages/signals.h"
#include "reference/trajectory/composition.h"

namespace tachless::reference::trajectory {

/// A constant position; all its derivatives are zero.
struct Hold {
  Vector position_rad;  ///< [rad; m if prismatic]

  static constexpr std::string_view name = "hold";
  static constexpr std::tuple keys{
      base::Key{"position_rad", &Hold::position_rad, "rad (m)", "Constant reference"}};

  /// Returns the reference, which is the same at any time.
  [[nodiscard]] messages::ReferencePoint at(double /*t_s*/) const {
    const Vector zero = Vector::Zero(position_rad.size());
    return {position_rad, zero, zero, zero, zero};
  }
  [[nodiscard]] Composition composition() const { return {}; }
};

}  // namespace tachless::reference::trajectory
