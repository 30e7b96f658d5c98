#include "report/sweep_map.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "study/measures.h"

namespace tachless::report {
namespace {

using study::Axis;
using study::SweepPlan;
using study::SweepRow;

/// Returns the interval of a value halfway to its neighbours, so that the cells of a grid touch.
std::pair<double, double> extent(const Axis& axis, double value) {
  std::vector<double> values = axis.values;
  std::ranges::sort(values);
  const auto at = std::ranges::lower_bound(values, value);
  const auto half = [&](double from, double to) {
    return axis.logarithmic ? std::sqrt(from * to) : (from + to) / 2;
  };
  const bool first = at == values.begin(), last = std::next(at) == values.end();
  if (first && last) {
    if (axis.logarithmic) return {value / 1.1, value * 1.1};
    const double room = 0.1 * std::abs(value) + 0.05;
    return {value - room, value + room};
  }
  const auto beyond = [&](double edge) {
    return axis.logarithmic ? value * value / edge : 2 * value - edge;
  };
  double low = first ? 0 : half(*std::prev(at), value);
  double high = last ? 0 : half(value, *std::next(at));
  if (first) low = beyond(high);
  if (last) high = beyond(low);
  return {low, high};
}

/// Returns the range of all cells of an axis, or nothing if it has no width.
std::optional<std::pair<double, double>> range_of(const Axis& axis) {
  double low = axis.low, high = axis.high;
  for (const double value : axis.values) {
    const auto [from, to] = extent(axis, value);
    low = value == axis.values.front() ? from : std::min(low, from);
    high = value == axis.values.front() ? to : std::max(high, to);
  }
  if (!(low < high)) return {};
  return {{low, high}};
}

std::string_view colour_of_outcome(study::Outcome outcome) {
  return outcome_colours.at(static_cast<std::size_t>(outcome));
}

/// The content of a place on the map. For several runs it is the worst outcome and the largest
/// measure.
struct Shown {
  study::Outcome outcome = study::Outcome::converged;
  double measure = NAN;  ///< NaN also for a run that was broken off
};
using Places = std::map<std::pair<double, double>, Shown>;

/// Adds a law's map to `chart`: cells, or points if values are drawn at random or there is one
/// axis.
void add_map(Chart& chart, const SweepPlan& plan, const Places& places) {
  const bool points = plan.axes.size() == 1 || plan.drawn > 0;
  std::set<study::Outcome> outcomes;
  for (const auto& [at, shown] : places) {
    const auto [x, y] = at;
    const bool measured = chart.scale && std::isfinite(shown.measure);
    if (!measured) outcomes.insert(shown.outcome);
    Cell cell{x, x, y, y,
              measured ? chart.scale->colour(shown.measure)
                       : std::string(colour_of_outcome(shown.outcome))};
    if (!points) {
      std::tie(cell.left, cell.right) = extent(plan.axes[0], x);
      std::tie(cell.bottom, cell.top) = extent(plan.axes[1], y);
    }
    chart.cells.push_back(std::move(cell));
  }
  for (const study::Outcome outcome : outcomes) {
    chart.curves.push_back({words(std::string(base::name_of(outcome))),
                            {},
                            std::string(colour_of_outcome(outcome)),
                            0});
    chart.curves.back().marker = Marker::square;
  }
}

/// The measure of a sweep's rows that a map shows, with its range.
struct Measured {
  std::size_t column;
  double lowest = INFINITY, highest = -INFINITY;  ///< smallest positive value; largest value
  bool positive = true;

  Measured(const std::vector<SweepRow>& rows, std::size_t measure) : column(measure) {
    for (const SweepRow& row : rows) {
      const double value = row.measures[column];
      if (!std::isfinite(value) || broken_off(row.outcome)) continue;
      if (value > 0) lowest = std::min(lowest, value);
      highest = std::max(highest, value);
      positive = positive && value > 0;
    }
  }
  [[nodiscard]] bool wide() const { return positive && highest > 100 * lowest; }
  [[nodiscard]] std::string name() const {
    return std::string(study::measure_columns()[column].name);
  }
};

/// Returns the places of all laws' maps.
std::map<std::string, Places> places_of(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                                        std::size_t measured) {
  std::map<std::string, Places> places;
  for (const SweepRow& row : rows) {
    const double measure = row.measures[measured];
    const double y = plan.axes.size() == 1 ? measure : row.which.values[1];
    if (!std::isfinite(y)) continue;
    Shown& shown = places[row.which.law][{row.which.values[0], y}];
    shown.outcome = std::max(shown.outcome, row.outcome);
    shown.measure = std::isnan(shown.measure) ? measure : std::max(shown.measure, measure);
    if (broken_off(shown.outcome)) shown.measure = NAN;
  }
  return places;
}

}  // namespace

Figure maps_figure(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                   const std::vector<std::size_t>& colour, const Outlines& certified) {
  const bool one_axis = plan.axes.size() == 1, by_measure = !colour.empty();
  const Measured measured(rows, by_measure ? colour.front() : usual_measure);
  std::map<std::string, Places> places = places_of(plan, rows, measured.column);
  const std::size_t columns = std::min<std::size_t>(plan.laws.size(), 3);
  Figure figure{
      plan.name, {}, columns, columns == 1 ? 720.0 : 460.0 * static_cast<double>(columns)};
  for (const study::SweepLaw& law : plan.laws) {
    Chart& chart = figure.charts.emplace_back();
    chart.over_time = false;
    chart.heading = law.name;
    chart.height_px = 320;
    chart.x_label = words(plan.axes[0].name());
    chart.y_label = words(one_axis ? measured.name() : plan.axes[1].name());
    chart.logarithmic_x = plan.axes[0].logarithmic;
    chart.logarithmic_y = one_axis ? measured.wide() : plan.axes[1].logarithmic;
    chart.x_range = range_of(plan.axes[0]);
    if (!one_axis) chart.y_range = range_of(plan.axes[1]);
    if (one_axis && measured.lowest < measured.highest) {
      chart.y_range = {{measured.wide() ? 0.8 * measured.lowest : 0.0, 1.1 * measured.highest}};
    }
    if (by_measure && !one_axis) {
      chart.scale = {words(measured.name()), measured.lowest, measured.highest, measured.wide()};
    }
    add_map(chart, plan, places[law.name]);
    const auto which = static_cast<std::size_t>(&law - plan.laws.data());
    if (which < certified.size() && !certified[which].empty()) {
      chart.curves.push_back({words("certified"), certified[which], "#000000", 2});
    }
  }
  return figure;
}

}  // namespace tachless::report
