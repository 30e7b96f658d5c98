#pragma once

#include <string_view>
#include <tuple>
#include <vector>

#include "base/schema.h"
#include "messages/signals.h"
#include "reference/trajectory/composition.h"
#include "reference/trajectory/hold.h"

namespace tachless::reference::trajectory {

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
  [[nodiscard]] Composition composition() const { return {{}, terms}; }
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
  [[nodiscard]] Composition composition() const { return {{}, {*this}}; }
};

}  // namespace tachless::reference::trajectory
