#include "report/sweep_curves.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "report/gnuplot.h"
#include "study/measures.h"

namespace tachless::report {
namespace {

using study::Axis;
using study::SweepPlan;
using study::SweepRow;

constexpr std::size_t most_columns = 4;
constexpr double row_of_marks = 0.03;  // of a diagram's height

/// How a run is marked.
enum class Mark { good, bad, broken_off };

Mark mark_of(const std::string& outcome) {
  if (outcome == "diverging" || outcome == "stopped") return Mark::broken_off;
  return outcome == "limit_cycle" || outcome == "saturated" ? Mark::bad : Mark::good;
}

/// The values of all axes but the first: what a column of diagrams has in common.
std::vector<double> column_of(const SweepRow& row) {
  return {row.which.values.begin() + 1, row.which.values.end()};
}

std::string title_of(const SweepPlan& plan, const std::vector<double>& column) {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < column.size(); ++i) {
    parts.push_back(fmt::format("{} = {:g}", plan.axes[i + 1].name(), column[i]));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

/// The ordinate of a row of diagrams.
struct Ordinate {
  double low = INFINITY, high = -INFINITY;
  bool logarithmic = false;

  /// With room at the upper edge for a row of marks for each law, where any run was broken off.
  Ordinate(const std::vector<SweepRow>& rows, std::size_t measure, std::size_t laws) {
    bool positive = true, broken_off = false;
    for (const SweepRow& row : rows) {
      const double value = row.measures[measure];
      broken_off = broken_off || mark_of(row.outcome) == Mark::broken_off;
      if (!std::isfinite(value) || mark_of(row.outcome) == Mark::broken_off) continue;
      positive = positive && value > 0;
      low = std::min(low, value);
      high = std::max(high, value);
    }
    logarithmic = positive && high > 100 * low;
    if (!(low <= high)) low = high = 1;  // nothing to be seen
    low = logarithmic ? low / 1.5 : std::min(0.0, 1.2 * low);
    high *= 1.5;
    if (high <= low) high = low + 1;
    if (broken_off) high = at(1 + row_of_marks * static_cast<double>(laws + 1));
  }
  /// `share` of the way from the lower edge to the upper one.
  [[nodiscard]] double at(double share) const {
    return logarithmic ? low * std::pow(high / low, share) : low + share * (high - low);
  }
};

/// What the diagrams are drawn of.
struct Diagram {
  const SweepPlan& plan;
  const std::vector<SweepRow>& rows;
  std::vector<double> column;
  std::size_t measure;
  Ordinate ordinate;

  /// Blocks of data and the plots of them.
  [[nodiscard]] std::string commands(std::size_t number) const {
    std::string blocks;
    std::vector<std::string> plots;
    for (std::size_t law = 0; law < plan.laws.size(); ++law) {
      std::map<double, std::string> line;  // by abscissa
      std::array<std::string, 3> marked;
      for (const SweepRow& row : rows) {
        if (row.which.law != plan.laws[law].name || column_of(row) != column) continue;
        const Mark mark = mark_of(row.outcome);
        const double x = row.which.values[0];
        const double y = mark == Mark::broken_off
                             ? ordinate.at(0.98 - row_of_marks * static_cast<double>(law))
                             : row.measures[measure];
        if (!std::isfinite(y)) continue;
        const std::string point = fmt::format("{:.9g} {:.9g}\n", x, y);
        marked[static_cast<std::size_t>(mark)] += point;
        if (mark != Mark::broken_off) line[x] = point;
      }
      const std::string colour = palette[law % palette.size()];
      std::string curve;
      for (const auto& [x, point] : line) curve += point;
      const auto add = [&](const std::string& name, const std::string& points,
                           const std::string& with, const std::string& title = "notitle") {
        const std::string block = fmt::format("$d{}_{}_{}", number, law, name);
        blocks += fmt::format("{} << EOD\n{}nan nan\nEOD\n", block, points);
        plots.push_back(fmt::format("{} with {} lc rgb '{}' {}", block, with, colour, title));
      };
      const bool dashed = law >= palette.size();
      add("line", curve, fmt::format("lines lw 1.6 dashtype {}", dashed ? "(8,4)" : "1"),
          "title " + gnuplot_text(plan.laws[law].name));
      add("good", marked[0], "points pt 7 ps 0.4");
      add("bad", marked[1], "points pt 6 ps 0.9");
      add("broken", marked[2], "points pt 2 ps 0.7");
    }
    const auto explain = [&](Mark mark, const char* point, const char* meaning) {
      if (std::ranges::none_of(rows, [&](auto& row) { return mark_of(row.outcome) == mark; }))
        return;
      plots.push_back(
          fmt::format("NaN with points {} lc rgb '#444444' title '{}'", point, meaning));
    };
    explain(Mark::bad, "pt 6 ps 0.9", "limit cycle, saturated");
    explain(Mark::broken_off, "pt 2 ps 0.7", "diverging, stopped");
    return fmt::format("{}plot {}\n", blocks, fmt::join(plots, ", "));
  }
};

std::vector<std::vector<double>> columns_of(const std::vector<SweepRow>& rows) {
  std::vector<std::vector<double>> all;
  for (const SweepRow& row : rows) {
    if (std::ranges::find(all, column_of(row)) == all.end()) all.push_back(column_of(row));
  }
  return all;
}

}  // namespace

bool shown_by_curves(const SweepPlan& plan) {
  if (plan.drawn > 0) return false;
  std::size_t columns = 1;
  for (std::size_t i = 1; i < plan.axes.size(); ++i) {
    if (plan.axes[i].text.find(',') == std::string::npos) return false;
    columns *= plan.axes[i].values.size();
  }
  return columns <= most_columns;
}

std::string sweep_curves(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                         const std::vector<std::size_t>& measures,
                         const std::filesystem::path& svg) {
  const std::vector<std::vector<double>> columns = columns_of(rows);
  const auto width = static_cast<double>(360 * columns.size() + 300);
  const auto height = static_cast<double>(270 * measures.size() + 110);
  std::string text = fmt::format(
      "set terminal svg size {},{} font 'sans,12' background '#ffffff'\nset encoding utf8\n"
      "set output {}\nset multiplot layout {},{} title {} font ',14' margins screen "
      "{:.4f},{:.4f},{:.4f},{:.4f} spacing screen {:.4f},{:.4f}\nset border 3\nset tics nomirror\n"
      "set grid lc rgb '#dddddd'\nset key at screen {:.4f},{:.4f} left top vertical Left reverse "
      "samplen 2\n",
      width, height, gnuplot_string(svg.string()), measures.size(), columns.size(),
      gnuplot_text(plan.name), 80 / width, 1 - 220 / width, 55 / height, 1 - 70 / height,
      55 / width, 45 / height, 1 - 205 / width, 1 - 70 / height);
  const auto [first, last] = std::ranges::minmax(plan.axes[0].values);
  if (first < last) text += fmt::format("set xrange [{:.9g}:{:.9g}]\n", first, last);
  if (plan.axes[0].logarithmic) text += "set logscale x\n";
  std::size_t number = 0;
  for (const std::size_t measure : measures) {
    const Ordinate ordinate(rows, measure, plan.laws.size());
    const study::MeasureColumn& of = study::measure_columns()[measure];
    text += fmt::format("{}set logscale y\nset format y '{}'\nset yrange [{:.9g}:{:.9g}]\n",
                        ordinate.logarithmic ? "" : "un", ordinate.logarithmic ? "10^{%T}" : "%g",
                        ordinate.low, ordinate.high);
    for (const std::vector<double>& column : columns) {
      text += fmt::format(
          "set title {}\nset xlabel {}\nset ylabel {}\n",
          gnuplot_text(measure == measures.front() ? title_of(plan, column) : ""),
          gnuplot_text(measure == measures.back() ? plan.axes[0].name() : ""),
          gnuplot_text(column == columns.front() ? fmt::format("{} [{}]", of.name, of.unit) : ""));
      text += Diagram{plan, rows, column, measure, ordinate}.commands(number);
      if (number++ == 0) text += "unset key\n";
    }
  }
  return text + "unset multiplot\n";
}

}  // namespace tachless::report
