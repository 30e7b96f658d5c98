#pragma once

#include <string_view>

#include "loop/signals.h"
#include "reference/trajectory/hold.h"
#include "reference/trajectory/multi_sine.h"
#include "schema/schema.h"

namespace tachless::reference::trajectory {

/// q_ref_i(t) = offset_i + amplitude_i sin(2 pi frequency_i t + phase_i), for all t.
struct Sinusoid {
  robot::Vector amplitude_rad;  ///< [rad; m if prismatic]
  robot::Vector frequency_hz;   ///< [Hz]
  robot::Vector phase_rad;      ///< [rad]
  robot::Vector offset_rad;     ///< [rad; m if prismatic]

  static constexpr std::string_view name = "sinusoid";
  static constexpr std::tuple keys{
      schema::Key{"amplitude_rad", &Sinusoid::amplitude_rad, "rad (m)",
                  "offset + amplitude sin(2π frequency t + phase)"},
      schema::Key{"frequency_hz", &Sinusoid::frequency_hz, "Hz", "Frequency"}.in(
          schema::not_negative),
      schema::Key{"phase_rad", &Sinusoid::phase_rad, "rad", "Phase at t = 0"}.by_default(0),
      schema::Key{"offset_rad", &Sinusoid::offset_rad, "rad (m)", "Middle"}.by_default(0)};

  /// Position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const {
    loop::ReferencePoint point = Hold{offset_rad}.at(t_s);
    add_sine(point, amplitude_rad, frequency_hz, phase_rad, t_s);
    return point;
  }
};

}  // namespace tachless::reference::trajectory
