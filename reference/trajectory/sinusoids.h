#pragma once

#include <cmath>
#include <numbers>
#include <string_view>
#include <vector>

#include "loop/signals.h"
#include "reference/trajectory/hold.h"
#include "schema/schema.h"

namespace tachless::reference::trajectory {

/// Adds amplitude_i sin(2 pi frequency_i t + phase_i) and its derivatives to `point`: a Sine or a
/// Sinusoid.
template <class Wave>
void add_sine(loop::ReferencePoint& point, const Wave& wave, double t_s) {
  for (Eigen::Index i = 0; i < wave.amplitude_rad.size(); ++i) {
    const double w = 2 * std::numbers::pi * wave.frequency_hz[i];
    const double angle = w * t_s + wave.phase_rad[i];
    const double s = wave.amplitude_rad[i] * std::sin(angle);
    const double c = wave.amplitude_rad[i] * std::cos(angle);
    point.q_ref[i] += s;
    point.v_ref[i] += w * c;
    point.a_ref[i] -= w * w * s;
    point.jerk_ref[i] -= w * w * w * c;
    point.snap_ref[i] += w * w * w * w * s;
  }
}

/// One sinusoid per joint, a term of `MultiSine`; all vectors have one entry per joint.
struct Sine {
  robot::Vector amplitude_rad;  ///< [rad; m if prismatic]
  robot::Vector frequency_hz;   ///< [Hz]
  robot::Vector phase_rad;      ///< [rad]

  static constexpr std::tuple keys{
      schema::Key{"amplitude_rad", &Sine::amplitude_rad, "rad (m)", "Amplitude"},
      schema::Key{"frequency_hz", &Sine::frequency_hz, "Hz", "Frequency"}.in(schema::not_negative),
      schema::Key{"phase_rad", &Sine::phase_rad, "rad", "Phase at t = 0"}.by_default(0)};
};

/// q_ref_i(t) = offset_i + sum over terms of amplitude_i sin(2 pi frequency_i t + phase_i),
/// for all t.
struct MultiSine {
  robot::Vector offset_rad;  ///< [rad; m if prismatic]
  std::vector<Sine> terms;

  static constexpr std::string_view name = "multi_sine";
  static constexpr std::tuple keys{
      schema::Key{"offset_rad", &MultiSine::offset_rad, "rad (m)", "offset + sum of sinusoids"}
          .by_default(0),
      schema::Key{"terms", &MultiSine::terms, "", "One map per sinusoid"}};

  /// Position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const {
    loop::ReferencePoint point = Hold{offset_rad}.at(t_s);
    for (const Sine& term : terms) add_sine(point, term, t_s);
    return point;
  }
};

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
    add_sine(point, *this, t_s);
    return point;
  }
};

}  // namespace tachless::reference::trajectory
