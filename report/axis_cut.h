#pragma once

#include <optional>
#include <string>
#include <vector>

#include "study/envelope.h"

/// Where a kick, at the start of a run say, would flatten the rest of a curve, its axis is cut.
namespace tachless::report {

struct Range {
  double low = 0, high = 0;

  [[nodiscard]] double span() const { return high - low; }
};

Range join(const Range& a, const Range& b);

Range range_of(const std::vector<study::Point>& curve);

/// The values of a curve but for the highest and the lowest 5 % of its points.
Range usual_range(const std::vector<study::Point>& curve);

/// The range to show, or nothing when all of it can be shown.
/// @param whole range of all curves; @param usual what must be seen of them
std::optional<Range> cut_at_kick(const Range& whole, const Range& usual);

/// "axis cut: peak 4768 N m".
std::string cut_note(const Range& whole, const std::string& unit);

}  // namespace tachless::report
