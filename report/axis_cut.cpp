#include "report/axis_cut.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tachless::report {
namespace {

constexpr double kick = 0.05;  // of the points, at most, at either end of the values

Range range_without(const std::vector<study::Point>& curve, double left_out) {
  if (curve.empty()) return {};
  std::vector<double> values;
  values.reserve(curve.size());
  for (const study::Point& point : curve) values.push_back(point.y);
  std::sort(values.begin(), values.end());
  const auto skip = static_cast<std::size_t>(left_out * static_cast<double>(values.size()));
  return {values[skip], values[values.size() - 1 - skip]};
}

}  // namespace

Range join(const Range& a, const Range& b) {
  return {std::min(a.low, b.low), std::max(a.high, b.high)};
}

Range range_of(const std::vector<study::Point>& curve) { return range_without(curve, 0); }

Range usual_range(const std::vector<study::Point>& curve) { return range_without(curve, kick); }

std::optional<Range> cut_at_kick(const Range& whole, const Range& usual) {
  if (!(usual.span() > 0) || whole.span() <= 4 * usual.span()) return {};
  const double margin = usual.span() / 4;
  return Range{usual.low - margin, usual.high + margin};
}

std::string cut_note(const Range& whole, const std::string& unit) {
  return fmt::format("axis cut: peak {:.4g} {}",
                     std::max(std::abs(whole.low), std::abs(whole.high)), unit);
}

}  // namespace tachless::report
