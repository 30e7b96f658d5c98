#pragma once

#include <numbers>
#include <string_view>
#include <tuple>
#include <vector>

#include "base/elementary.h"
#include "base/schema.h"
#include "messages/signals.h"
#include "reference/trajectory/hold.h"

namespace tachless::reference::trajectory {

/// One sine wave per joint; all vectors have one entry per joint.
struct Sine {
  Vector amplitude_rad;  ///< [rad; m if prismatic]
  Vector frequency_hz;   ///< [Hz]
  Vector phase_rad;      ///< [rad]

  static constexpr std::tuple keys{
      base::Key{"amplitude_rad", &Sine::amplitude_rad, "rad (m)",
                "amplitude sin(2π frequency t + phase)"},
      base::Key{"frequency_hz", &Sine::frequency_hz, "Hz", "Frequency"}.in(base::not_negative),
      base::Key{"phase_rad", &Sine::phase_rad, "rad", "Phase at t = 0"}.by_default(0)};

  /// Adds amplitude_i sin(2 pi frequency_i t + phase_i) and its derivatives.
  void add_to(messages::ReferencePoint& point, double t_s) const {
    for (Eigen::Index i = 0; i < amplitude_rad.size(); ++i) {
      const double w = 2 * std::numbers::pi * frequency_hz[i];
      const double angle = w * t_s + phase_rad[i];
      double s = 0, c = 0;
      base::sin_cos(angle, s, c);
      s *= amplitude_rad[i];
      c *= amplitude_rad[i];
      point.q_ref[i] += s;
      point.v_ref[i] += w * c;
      point.a_ref[i] -= w * w * s;
      point.jerk_ref[i] -= w * w * w * c;
      point.snap_ref[i] += w * w * w * w * s;
    }
  }
};

/// Trajectory q_ref_i(t) = offset_i + sum over terms of amplitude_i sin(2 pi frequency_i t +
/// phase_i), for all t.
struct MultiSine {
  Vector offset_rad;  ///< [rad; m if prismatic]
  std::vector<Sine> terms;

  static constexpr std::string_view name = "multi_sine";
  static constexpr std::tuple keys{
      base::Key{"offset_rad", &MultiSine::offset_rad, "rad (m)", "offset + sum of sinusoids"}
          .by_default(0),
      base::Key{"terms", &MultiSine::terms, "", "One map per sinusoid"}};

  /// Returns position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] messages::ReferencePoint at(double t_s) const {
    messages::ReferencePoint point = Hold{offset_rad}.at(t_s);
    for (const Sine& term : terms) term.add_to(point, t_s);
    return point;
  }
};

/// Trajectory q_ref_i(t) = offset_i + amplitude_i sin(2 pi frequency_i t + phase_i), for all t.
struct Sinusoid : Sine {
  Vector offset_rad;  ///< [rad; m if prismatic]

  static constexpr std::string_view name = "sinusoid";
  static constexpr auto keys = std::tuple_cat(
      Sine::keys,
      std::tuple{
          base::Key{"offset_rad", &Sinusoid::offset_rad, "rad (m)", "Middle"}.by_default(0)});

  /// Returns position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] messages::ReferencePoint at(double t_s) const {
    messages::ReferencePoint point = Hold{offset_rad}.at(t_s);
    add_to(point, t_s);
    return point;
  }
};

}  // namespace tachless::reference::trajectory
