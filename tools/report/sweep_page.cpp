#include "report/sweep_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <string_view>
#include <utility>

#include "base/failure.h"
#include "base/text.h"
#include "report/html.h"
#include "study/measures.h"

namespace tachless::report {
namespace {

using study::Axis;
using study::SweepPlan;
using study::SweepRow;

/// Marks of runs among curves.
enum class RunMark { good, bad, broken_off };

RunMark mark_of(const SweepRow& row) {
  if (study::broken_off(row.outcome)) return RunMark::broken_off;
  return study::bad(row.outcome) ? RunMark::bad : RunMark::good;
}

robot::JointLabels joints_of(const SweepPlan& plan) {
  return robot::joint_labels(*plan.scenario(plan.at(0)).model);
}

/// Returns the values of all axes but the first. They are common to a column of diagrams.
std::vector<double> column_of(const SweepRow& row) {
  return {row.which.values.begin() + 1, row.which.values.end()};
}

std::string title_of(const SweepPlan& plan, const std::vector<double>& column) {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < column.size(); ++i) {
    parts.push_back(fmt::format("{} = {:g}", plan.axes[i + 1].name(), column[i]));
  }
  return base::joined(parts);
}

constexpr double row_of_marks = 0.03;  // share of a diagram's height

/// The ordinate of a row of diagrams.
struct Ordinate {
  double low = INFINITY, high = -INFINITY;
  bool logarithmic = false;

  /// Fits the range to the values. If any run was broken off, leaves room at the upper edge for a
  /// row of marks for each law.
  Ordinate(const std::vector<SweepRow>& rows, std::size_t measure, std::size_t laws) {
    bool positive = true, broken_off = false;
    for (const SweepRow& row : rows) {
      const double value = row.measures[measure];
      broken_off = broken_off || mark_of(row) == RunMark::broken_off;
      if (!std::isfinite(value) || mark_of(row) == RunMark::broken_off) continue;
      positive = positive && value > 0;
      low = std::min(low, value);
      high = std::max(high, value);
    }
    logarithmic = positive && high > 100 * low;
    if (!(low <= high)) low = high = 1;  // there is no value to show
    low = logarithmic ? low / 1.5 : std::min(0.0, 1.2 * low);
    high *= 1.5;
    if (high <= low) high = low + 1;
    if (broken_off) high = at(1 + row_of_marks * static_cast<double>(laws + 1));
  }
  /// Returns the value at `share` of the way from the lower edge to the upper edge.
  [[nodiscard]] double at(double share) const {
    return logarithmic ? low * std::pow(high / low, share) : low + share * (high - low);
  }
};

constexpr std::array markers = {Marker::dot, Marker::ring, Marker::cross};

/// Returns the curves of a measure over the first axis: for each law the line, and the points by
/// their marks.
std::vector<Curve> curves_of(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                             const std::vector<double>& column, std::size_t measure,
                             const Ordinate& ordinate) {
  constexpr std::array meanings = {"", "rests beside, saturated, oscillates", "diverging, stopped"};
  std::vector<Curve> curves;
  for (std::size_t law = 0; law < plan.laws.size(); ++law) {
    std::map<double, double> line;  // value by abscissa
    std::array<std::vector<study::Point>, markers.size()> marked;
    for (const SweepRow& row : rows) {
      if (row.which.law != plan.laws[law].name || column_of(row) != column) continue;
      const bool broken_off = mark_of(row) == RunMark::broken_off;
      const double x = row.which.values[0];
      const double y = broken_off ? ordinate.at(0.98 - row_of_marks * static_cast<double>(law))
                                  : row.measures[measure];
      if (!std::isfinite(y)) continue;
      marked[static_cast<std::size_t>(mark_of(row))].push_back({x, y});
      if (!broken_off) line[x] = y;
    }
    Curve curve{words(plan.laws[law].name), {}, colour_of(law), 1.6, dash_of(law)};
    for (const auto& [x, y] : line) curve.points.push_back({x, y});
    curves.push_back(std::move(curve));
    for (std::size_t mark = 0; mark < markers.size(); ++mark) {
      if (marked[mark].empty()) continue;
      curves.push_back({{}, marked[mark], colour_of(law), 0});
      curves.back().marker = markers[mark];
    }
  }
  for (const RunMark mark : {RunMark::bad, RunMark::broken_off}) {
    if (std::ranges::find(rows, mark, mark_of) == rows.end()) continue;
    const auto i = static_cast<std::size_t>(mark);
    curves.push_back({words(meanings[i]), {}, "#444444", 0});
    curves.back().marker = markers[i];
  }
  return curves;
}

/// Returns a table of the number of runs per law and outcome.
Html outcome_table(const SweepPlan& plan, const std::vector<SweepRow>& rows) {
  std::map<std::string, std::map<study::Outcome, int>> count;
  std::set<study::Outcome> seen;
  for (const SweepRow& row : rows) {
    ++count[row.which.law][row.outcome];
    seen.insert(row.outcome);
  }
  const auto head = [](study::Outcome outcome) {
    return html("<th>{}</th>", base::name_of(outcome));
  };
  const auto body = [&](const study::SweepLaw& law) {
    return html(
        "<tr><th>{}</th>{}<td>{}</td></tr>\n", law.name,
        each(seen,
             [&](study::Outcome outcome) { return html("<td>{}</td>", count[law.name][outcome]); }),
        base::joined(law.overrides, "; "));
  };
  return html("<table><tr><th>law</th>{}<th>set</th></tr>\n{}</table>\n", each(seen, head),
              each(plan.laws, body));
}

/// Returns the figure of a comparison's settled error over its torque noise: a point for each law
/// and tuning.
Figure trade_off(const SweepPlan& plan, const std::vector<SweepRow>& rows) {
  const auto columns = study::measure_columns(true);
  const auto at = [&](std::string_view name) {
    return static_cast<std::size_t>(std::ranges::find(columns, name, &study::MeasureColumn::name) -
                                    columns.begin());
  };
  const std::size_t noise = at("torque_noise"), error = at("settled_error");
  const robot::JointLabels joints = joints_of(plan);
  const auto label = [&](std::size_t column) {
    return words(std::string(columns[column].name), study::unit_of(columns[column], joints));
  };
  Figure figure{"", {}, 1, 760};
  Chart& chart = figure.charts.emplace_back();
  chart.over_time = false;
  chart.height_px = 360;
  chart.x_label = label(noise);
  chart.y_label = label(error);
  chart.logarithmic_x = chart.logarithmic_y = true;
  std::vector<std::string> laws;
  for (const SweepRow& row : rows) {
    const study::Point point{row.measures[noise], row.measures[error]};
    if (!(point.x > 0 && point.y > 0) || study::broken_off(row.outcome)) continue;
    if (laws.empty() || laws.back() != row.which.law) {
      laws.push_back(row.which.law);
      const std::string colour = colour_of(laws.size() - 1);
      chart.curves.push_back({words(laws.back()), {}, colour, 1.4, dash_of(laws.size() - 1)});
      chart.curves.push_back({{}, {}, colour, 0});
      chart.curves.back().marker = Marker::dot;
    }
    chart.curves.end()[-2].points.push_back(point);
    chart.curves.back().points.push_back(point);
  }
  return figure;
}

/// Writes the page of a comparison: a row of all measures and settings for each law.
void write_comparison_page(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                           const std::filesystem::path& directory) {
  const robot::JointLabels joints = joints_of(plan);
  const auto head = [&](const study::MeasureColumn& column) {
    return html("<th class=\"number\">{}<br>{}</th>", column.name, study::unit_of(column, joints));
  };
  const auto cell = [](double value) {
    return html("<td class=\"number\">{}</td>",
                std::isfinite(value) ? fmt::format("{:.3g}", value) : "-");
  };
  const auto body = [&](const SweepRow& row) {
    return html("<tr><th>{}</th><td>{}{}</td>{}</tr>\n", row.which.law, base::name_of(row.outcome),
                row.stopped.empty() ? "" : ": " + row.stopped, each(row.measures, cell));
  };
  const auto gains = [](const study::SweepLaw& law) {
    return html("<li>{}: <code>{}</code></li>\n", law.name,
                law.overrides.empty() ? "as in the scenario" : base::joined(law.overrides, "; "));
  };
  const Figure figure = trade_off(plan, rows);
  Html drawing;
  if (!figure.charts[0].curves.empty()) {
    write_figure(figure, directory / "trade_off.svg", study_remedy);
    drawing = html("<figure>{}</figure>\n", inline_svg(figure, "Settled error over torque noise"));
  }
  write_study_page(
      directory / "index.html", "Laws compared: " + plan.name,
      html("<p class=\"lead\">Every run is a row of <a href=\"results.csv\">results.csv</a>.</p>\n"
           "<div "
           "class=\"table\"><table><tr><th>law</th><th>outcome</th>{}</tr>\n{}</table></div>\n{}"
           "<h2>Gains</h2>\n<ul>{}</ul>\n",
           each(study::measure_columns(true), head), each(rows, body), drawing,
           each(plan.laws, gains)),
      plan.text);
}

}  // namespace

bool shown_by_curves(const SweepPlan& plan) {
  if (plan.drawn > 0) return false;
  std::size_t columns = 1;
  for (std::size_t i = 1; i < plan.axes.size(); ++i) {
    if (plan.axes[i].text.find(',') == std::string::npos) return false;
    columns *= plan.axes[i].values.size();
  }
  return columns <= 4;
}

std::vector<std::size_t> measures_shown(const SweepPlan& plan, const std::string& colour) {
  if (colour == "outcome") return {};
  const auto columns = study::measure_columns();
  std::vector<std::string_view> names(columns.size());
  std::ranges::transform(columns, names.begin(), &study::MeasureColumn::name);
  std::vector<std::size_t> measures;
  for (const std::string_view name : base::split(colour, ',')) {
    const auto found = std::ranges::find(names, name);
    if (found == names.end()) {
      throw base::bad_usage("--colour {}: no measure; allowed: outcome, {}", colour,
                            base::joined(names));
    }
    measures.push_back(static_cast<std::size_t>(found - names.begin()));
  }
  if (measures.size() > 1 && !shown_by_curves(plan)) {
    throw base::bad_usage("--colour {}: a map shows one measure; curves, over one axis, show many",
                          colour);
  }
  return measures;
}

Figure curves_figure(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                     const std::vector<std::size_t>& measures) {
  std::vector<std::vector<double>> columns;
  for (const SweepRow& row : rows) {
    if (std::ranges::find(columns, column_of(row)) == columns.end()) {
      columns.push_back(column_of(row));
    }
  }
  if (columns.empty()) columns.emplace_back();
  const double width_px = columns.size() == 1 ? 760.0 : 430.0 * static_cast<double>(columns.size());
  Figure figure{plan.name, {}, columns.size(), width_px, true};
  const auto [first, last] = std::ranges::minmax(plan.axes[0].values);
  for (const std::size_t measure : measures) {
    const Ordinate ordinate(rows, measure, plan.laws.size());
    const study::MeasureColumn& shown = study::measure_columns()[measure];
    for (const std::vector<double>& column : columns) {
      Chart& chart = figure.charts.emplace_back();
      chart.over_time = false;
      chart.height_px = 220;
      if (measure == measures.front()) chart.heading = title_of(plan, column);
      chart.x_label = words(plan.axes[0].name());
      if (column == columns.front()) {
        chart.y_label = words(std::string(shown.name), study::unit_of(shown, joints_of(plan)));
      }
      if (first < last) chart.x_range = {{first, last}};
      chart.y_range = {{ordinate.low, ordinate.high}};
      chart.logarithmic_x = plan.axes[0].logarithmic;
      chart.logarithmic_y = ordinate.logarithmic;
      chart.curves = curves_of(plan, rows, column, measure, ordinate);
    }
  }
  return figure;
}

void write_sweep_page(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory,
                      const Outlines& certified) {
  if (plan.is_comparison()) return write_comparison_page(plan, rows, directory);
  const std::vector<std::size_t> shown = measures_shown(plan, colour);
  const bool curves = shown_by_curves(plan);
  const Figure figure =
      !curves ? maps_figure(plan, rows, shown, certified)
              : curves_figure(plan, rows, shown.empty() ? std::vector{usual_measure} : shown);
  write_figure(figure, directory / "map.svg", study_remedy);
  const Html drawing = html(
      "<figure>{}</figure>\n",
      inline_svg(figure, fmt::format("{} of the sweep: {}", curves ? "Curves" : "Map", colour)));
  const Html axes =
      each(plan.axes, [](const Axis& axis) { return html("<li><code>{}</code></li>", axis.text); });
  const std::string how = plan.drawn > 0 ? fmt::format(", drawn with seed {}", plan.seed) : "";
  write_study_page(
      directory / "index.html", "Sweep of " + plan.name,
      html("<p class=\"lead\">{} runs{}. Every run is a row of <a "
           "href=\"results.csv\">results.csv</a>.</p>\n<ul>{}</ul>\n{}<h2>Outcomes</h2>\n{}",
           rows.size(), how, axes, drawing, outcome_table(plan, rows)),
      plan.text);
}

}  // namespace tachless::report
