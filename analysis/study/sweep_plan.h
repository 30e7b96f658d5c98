#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "scenario/scenario.h"

/// The runs of a sweep: a function from the number of a case to a scenario. This header runs
/// nothing. Cases are numbered from 0, laws outermost, the last axis innermost. A drawn value
/// depends on seed, case and axis alone.
namespace tachless::study {

/// A number of the scenario that is varied.
struct Axis {
  std::string text;          ///< as it was given
  std::string key;           ///< "controller.gains.kp"
  std::optional<int> entry;  ///< entry of a list, from 0; nothing: the whole list
  bool factor = false;       ///< the values multiply what the scenario has
  bool logarithmic = false;
  std::vector<double> values;  ///< values of a grid
  double low = 0, high = 0;    ///< range of a drawn value

  /// Returns e.g. "controller.gains.kp*", as in the header of a table.
  [[nodiscard]] std::string name() const { return text.substr(0, text.find('=')); }
};

/// Parses an axis: "loop.period_s=1e-4:1e-2:9:log" (from, to, number of values),
/// "plant.encoder.resolution_bits=12,16,20", "plant.initial.position_rad[0]=-1:1:21" (one joint),
/// "controller.gains.kp*=0.1:10:13:log" (times the scenario's value). A drawn axis has no number of
/// values: "controller.gains.kp*=0.1:10:log".
/// @throw base::Failure(bad_usage) naming `text` and what is wrong with it
Axis parse_axis(const std::string& text, bool drawn);

/// A law of a sweep, and the law's changes of the scenario.
struct SweepLaw {
  std::string name;
  std::vector<std::string> overrides;  ///< settings "key=value" of the law's parameters
};

/// The case that a row of the results is about.
struct SweepCase {
  std::int64_t index = 0;
  std::string law;
  std::vector<double> values;  ///< value of each axis, in the axes' order
};

/// Scenario, laws and axes of a sweep.
struct SweepPlan {
  std::string name, source;  ///< of the scenario, and its file
  std::string text, urdf;    ///< the scenario, and its robot's description
  int num_joints = 0;
  std::vector<SweepLaw> laws;  ///< at least one
  std::vector<Axis> axes;
  std::int64_t drawn = 0;  ///< cases that are drawn; 0: the grid of all axes
  std::uint64_t seed = 1;

  /// Returns true if there are no axes. The sweep then compares laws by one run of each.
  [[nodiscard]] bool is_comparison() const { return axes.empty(); }
  /// Adds an axis.
  /// @throw base::Failure(bad_usage) if another axis varies the same number.
  void add(Axis axis);
  [[nodiscard]] std::int64_t cases_per_law() const;
  [[nodiscard]] std::int64_t num_cases() const {
    return cases_per_law() * static_cast<std::int64_t>(laws.size());
  }
  /// Returns the case with this number.
  [[nodiscard]] SweepCase at(std::int64_t index) const;
  /// Returns the scenario of a case. If loop.period_s is varied, the run's length becomes the
  /// nearest whole number of periods.
  /// @throw base::Failure(bad_usage) when the scenario does not take the values.
  [[nodiscard]] scenario::Scenario scenario(const SweepCase& which) const;

  [[nodiscard]] std::string json() const;
  /// Reads a plan.
  /// @throw base::Failure(bad_usage) naming `source` when it is no plan
  static SweepPlan from_json(const std::string& json, const std::string& source);
};

}  // namespace tachless::study
