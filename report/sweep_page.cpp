#include "report/sweep_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <string_view>
#include <utility>

#include "certificate/parallel.h"
#include "certificate/stability_certificate.h"
#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "report/gnuplot.h"
#include "report/html.h"
#include "study/measures.h"

namespace tachless::report {
namespace {

using study::Axis;
using study::SweepPlan;
using study::SweepRow;

constexpr std::size_t usual_measure = 1;  // rms_error

/// How a run is marked among curves.
enum class Mark { good, bad, broken_off };

struct OutcomeLook {
  std::string_view outcome, colour;
  Mark mark;
};
/// From the best to the worst.
constexpr std::array outcome_looks = {OutcomeLook{"converged", "#009E73", Mark::good},
                                      OutcomeLook{"followed", "#56B4E9", Mark::good},
                                      OutcomeLook{"not_judged", "#BBBBBB", Mark::good},
                                      OutcomeLook{"saturated", "#E69F00", Mark::bad},
                                      OutcomeLook{"limit_cycle", "#CC79A7", Mark::bad},
                                      OutcomeLook{"diverging", "#D55E00", Mark::broken_off},
                                      OutcomeLook{"stopped", "#000000", Mark::broken_off}};

std::size_t severity(std::string_view outcome) {
  const auto found = std::ranges::find(outcome_looks, outcome, &OutcomeLook::outcome);
  return static_cast<std::size_t>(found - outcome_looks.begin());
}

Mark mark_of(const SweepRow& row) { return outcome_looks.at(severity(row.outcome)).mark; }

std::string scale(const char* axis, bool logarithmic) {
  return fmt::format("{}set logscale {}\n", logarithmic ? "" : "un", axis);
}

/// The values of all axes but the first: what a column of curves' diagrams has in common.
std::vector<double> column_of(const SweepRow& row) {
  return {row.which.values.begin() + 1, row.which.values.end()};
}

std::string title_of(const SweepPlan& plan, const std::vector<double>& column) {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < column.size(); ++i) {
    parts.push_back(fmt::format("{} = {:g}", plan.axes[i + 1].name(), column[i]));
  }
  return diagnostics::joined(parts);
}

constexpr double row_of_marks = 0.03;  // of a diagram's height

/// The ordinate of a row of diagrams.
struct Ordinate {
  double low = INFINITY, high = -INFINITY;
  bool logarithmic = false;

  /// With room at the upper edge for a row of marks for each law, where any run was broken off.
  Ordinate(const std::vector<SweepRow>& rows, std::size_t measure, std::size_t laws) {
    bool positive = true, broken_off = false;
    for (const SweepRow& row : rows) {
      const double value = row.measures[measure];
      broken_off = broken_off || mark_of(row) == Mark::broken_off;
      if (!std::isfinite(value) || mark_of(row) == Mark::broken_off) continue;
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

/// A measure over the first axis: of each law the line, and the points by their marks.
Plot diagram(const SweepPlan& plan, const std::vector<SweepRow>& rows,
             const std::vector<double>& column, std::size_t measure, const Ordinate& ordinate) {
  constexpr std::array points = {"points pt 7 ps 0.4", "points pt 6 ps 0.9", "points pt 2 ps 0.7"};
  constexpr std::array meanings = {"", "limit cycle, saturated", "diverging, stopped"};
  Plot plot;
  for (std::size_t law = 0; law < plan.laws.size(); ++law) {
    std::map<double, std::string> line;  // by abscissa
    std::array<std::string, points.size()> marked;
    for (const SweepRow& row : rows) {
      if (row.which.law != plan.laws[law].name || column_of(row) != column) continue;
      const bool broken_off = mark_of(row) == Mark::broken_off;
      const double x = row.which.values[0];
      const double y = broken_off ? ordinate.at(0.98 - row_of_marks * static_cast<double>(law))
                                  : row.measures[measure];
      if (!std::isfinite(y)) continue;
      const std::string point = fmt::format("{:.9g} {:.9g}\n", x, y);
      marked[static_cast<std::size_t>(mark_of(row))] += point;
      if (!broken_off) line[x] = point;
    }
    const std::string colour = palette[law % palette.size()];
    std::string curve;
    for (const auto& [x, point] : line) curve += point;
    plot.add(curve, fmt::format("with lines lw 1.6 dashtype {} lc rgb '{}' {}",
                                law < palette.size() ? "1" : "(8,4)", colour,
                                titled(plan.laws[law].name)));
    for (std::size_t mark = 0; mark < points.size(); ++mark) {
      plot.add(marked[mark], fmt::format("with {} lc rgb '{}' notitle", points[mark], colour));
    }
  }
  for (const Mark mark : {Mark::bad, Mark::broken_off}) {
    if (std::ranges::find(rows, mark, mark_of) == rows.end()) continue;
    const auto i = static_cast<std::size_t>(mark);
    plot.add(fmt::format("NaN with {} lc rgb '#444444' title '{}'", points[i], meanings[i]));
  }
  return plot;
}

/// What --colour asks for.
struct Colour {
  std::vector<std::size_t> measures;  ///< indices into `measure_columns`; empty: outcomes
  bool certified = false;             ///< which initial states are certified, too
};

/// @throw diagnostics::Failure(bad_usage) when there is no such measure
Colour parse_colour(const std::string& text) {
  Colour colour{{}, text == "certified"};
  if (text == "outcome" || colour.certified) return colour;
  std::vector<std::string_view> names(study::measure_columns().size());
  std::ranges::transform(study::measure_columns(), names.begin(), &study::MeasureColumn::name);
  for (std::size_t from = 0; from <= text.size();) {
    const std::size_t to = std::min(text.find(',', from), text.size());
    const auto found = std::find(names.begin(), names.end(), text.substr(from, to - from));
    if (found == names.end()) {
      throw diagnostics::bad_usage("--colour {}: no measure; allowed: outcome, certified, {}", text,
                                   diagnostics::joined(names));
    }
    colour.measures.push_back(static_cast<std::size_t>(found - names.begin()));
    from = to + 1;
  }
  return colour;
}

/// Of each row, whether the initial state of its run is certified (certificate/).
std::vector<char> certified_rows(const SweepPlan& plan, const std::vector<SweepRow>& rows) {
  std::vector<char> certified(rows.size());
  certificate::parallel_for(rows.size(), [&](std::size_t i) {
    const auto run = certificate::certified_run(plan.scenario(rows[i].which));
    certified[i] = run && run->rate >= 0 ? 1 : 0;
  });
  return certified;
}

/// Half-way to the neighbours, so that the cells of a grid touch.
std::pair<double, double> extent(const Axis& axis, double value) {
  std::vector<double> values = axis.values;
  std::ranges::sort(values);
  const auto at = std::ranges::lower_bound(values, value);
  const auto half = [&](double from, double to) {
    return axis.logarithmic ? std::sqrt(from * to) : (from + to) / 2;
  };
  const bool first = at == values.begin(), last = std::next(at) == values.end();
  if (first && last) return {value * 0.9 - 0.05, value * 1.1 + 0.05};
  const auto beyond = [&](double edge) {
    return axis.logarithmic ? value * value / edge : 2 * value - edge;
  };
  double low = first ? 0 : half(*std::prev(at), value);
  double high = last ? 0 : half(value, *std::next(at));
  if (first) low = beyond(high);
  if (last) high = beyond(low);
  return {low, high};
}

std::string range(const char* axis, const Axis& of) {
  double low = of.low, high = of.high;
  for (const double value : of.values) {
    const auto [from, to] = extent(of, value);
    low = value == of.values.front() ? from : std::min(low, from);
    high = value == of.values.front() ? to : std::max(high, to);
  }
  return low < high ? fmt::format("set {}range [{:.9g}:{:.9g}]\n", axis, low, high) : "";
}

/// What a place on the map shows: of several runs the worst outcome, the largest measure.
struct Shown {
  std::size_t outcome = 0;
  double measure = NAN;
  bool certified = true;
};
using Places = std::map<std::pair<double, double>, Shown>;

/// A law's map: its cells, or points where values are drawn or there is one axis.
Plot law_map(const SweepPlan& plan, const Places& places, bool by_measure) {
  const bool points = plan.axes.size() == 1 || plan.drawn > 0;
  std::map<std::size_t, std::string> data;  // by outcome
  std::string certified;
  for (const auto& [at, shown] : places) {
    const auto [x, y] = at;
    if (shown.certified) certified += fmt::format("{:.9g} {:.9g}\n", x, y);
    if (by_measure && std::isnan(shown.measure)) continue;
    std::string place = fmt::format("{:.9g} {:.9g}", x, y);
    if (!points) {
      const auto [left, right] = extent(plan.axes[0], x);
      const auto [low, high] = extent(plan.axes[1], y);
      place += fmt::format(" {:.9g} {:.9g} {:.9g} {:.9g}", left, right, low, high);
    }
    data[by_measure ? 0 : shown.outcome] += fmt::format("{} {:.9g}\n", place, shown.measure);
  }
  Plot plot;
  for (const auto& [outcome, rows] : data) {
    const OutcomeLook& look = outcome_looks.at(outcome);
    plot.add(rows, fmt::format(
                       "using {}{} with {} lc {}", points ? "1:2" : "1:2:3:4:5:6",
                       !by_measure ? ""
                       : points    ? ":3"
                                   : ":7",
                       points ? "points pt 7 ps 0.6" : "boxxyerror fs solid noborder",
                       by_measure ? "palette notitle"
                                  : fmt::format("rgb '{}' {}", look.colour, titled(look.outcome))));
  }
  if (!certified.empty()) {
    plot.add(certified, "with points pt 7 ps 0.4 lc rgb '#ffffff' notitle");
    plot.add("NaN with points pt 6 ps 0.6 lc rgb '#444444' title 'certified'");
  }
  if (plot.empty()) plot.add("[0:1][0:1] NaN notitle");
  return plot;
}

/// gnuplot's commands for the maps of all laws.
std::string sweep_maps(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                       const Colour& colour) {
  const bool one_axis = plan.axes.size() == 1, by_measure = !colour.measures.empty();
  const std::size_t measured = by_measure ? colour.measures.front() : usual_measure;
  const std::vector<char> certified =
      colour.certified ? certified_rows(plan, rows) : std::vector<char>(rows.size());
  bool positive = true;
  double lowest = INFINITY, highest = -INFINITY;
  std::map<std::string, Places> places;  // by law
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const SweepRow& row = rows[i];
    const double measure = row.measures[measured];
    const double y = one_axis ? measure : row.which.values[1];
    if (!std::isfinite(y)) continue;
    Shown& shown = places[row.which.law][{row.which.values[0], y}];
    shown.outcome = std::max(shown.outcome, severity(row.outcome));
    shown.certified = shown.certified && certified[i] != 0;
    shown.measure = std::isnan(shown.measure) ? measure : std::max(shown.measure, measure);
    if (measure > 0) lowest = std::min(lowest, measure);
    if (std::isfinite(measure)) highest = std::max(highest, measure);
    positive = positive && !(measure <= 0);
  }
  const bool wide = positive && highest > 100 * lowest;
  const std::string name(study::measure_columns()[measured].name);
  const std::size_t laws = plan.laws.size(), columns = std::min<std::size_t>(laws, 3);
  const std::size_t lines = (laws + columns - 1) / columns;
  std::string text = fmt::format(
      "set terminal svg size {},{} font 'sans,11' background '#ffffff'\n"
      "set multiplot layout {},{} title {} font ',14'\nset key below horizontal samplen 1 height "
      "0.7\nset border 3\nset tics nomirror\n{}{}{}"
      "set xlabel {}\nset ylabel {}\nset cblabel {}\n{}",
      columns == 1 ? 720 : 480 * columns, 430 * lines + 30, lines, columns, gnuplot_text(plan.name),
      scale("x", plan.axes[0].logarithmic), scale("y", one_axis ? wide : plan.axes[1].logarithmic),
      scale("cb", wide), gnuplot_text(plan.axes[0].name()),
      gnuplot_text(one_axis ? name : plan.axes[1].name()), gnuplot_text(name),
      range("x", plan.axes[0]));
  if (!one_axis) {
    text += range("y", plan.axes[1]);
  } else if (lowest < highest) {
    text += fmt::format("set yrange [{:.9g}:{:.9g}]\n", wide ? 0.8 * lowest : 0.0, 1.1 * highest);
  }
  // From blue through white to red, told apart by people with any colour vision.
  text += "set palette defined (0 '#2166AC', 0.5 '#F7F7F7', 1 '#B2182B')\n";
  for (const study::SweepLaw& law : plan.laws) {
    text += law_map(plan, places[law.name], by_measure && !one_axis)
                .commands(fmt::format("set title {}\n", gnuplot_text(law.name)));
  }
  return text + "unset multiplot\n";
}

/// How many runs of each law ended how.
Html outcome_table(const SweepPlan& plan, const std::vector<SweepRow>& rows) {
  std::map<std::string, std::map<std::string_view, int>> count;
  for (const SweepRow& row : rows) ++count[row.which.law][row.outcome];
  const auto head = [](const OutcomeLook& look) { return html("<th>{}</th>", look.outcome); };
  const auto body = [&](const study::SweepLaw& law) {
    return html("<tr><th>{}</th>{}<td>{}</td></tr>\n", law.name,
                each(outcome_looks,
                     [&](const OutcomeLook& look) {
                       return html("<td>{}</td>", count[law.name][look.outcome]);
                     }),
                diagnostics::joined(law.overrides, "; "));
  };
  return html("<table><tr><th>law</th>{}<th>set</th></tr>\n{}</table>\n", each(outcome_looks, head),
              each(plan.laws, body));
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

std::string sweep_curves(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                         const std::vector<std::size_t>& measures) {
  std::vector<std::vector<double>> columns;
  for (const SweepRow& row : rows) {
    if (std::ranges::find(columns, column_of(row)) == columns.end()) {
      columns.push_back(column_of(row));
    }
  }
  const auto width = static_cast<double>(360 * columns.size() + 300);
  const auto height = static_cast<double>(270 * measures.size() + 110);
  std::string text = fmt::format(
      "set terminal svg size {},{} font 'sans,12' background '#ffffff'\nset encoding utf8\n"
      "set multiplot layout {},{} title {} font ',14' margins screen "
      "{:.4f},{:.4f},{:.4f},{:.4f} spacing screen {:.4f},{:.4f}\nset border 3\nset tics nomirror\n"
      "set grid lc rgb '#dddddd'\nset key at screen {:.4f},{:.4f} left top vertical Left reverse "
      "samplen 2\n",
      width, height, measures.size(), columns.size(), gnuplot_text(plan.name), 80 / width,
      1 - 220 / width, 55 / height, 1 - 70 / height, 55 / width, 45 / height, 1 - 205 / width,
      1 - 70 / height);
  const auto [first, last] = std::ranges::minmax(plan.axes[0].values);
  if (first < last) text += fmt::format("set xrange [{:.9g}:{:.9g}]\n", first, last);
  if (plan.axes[0].logarithmic) text += "set logscale x\n";
  bool key = true;  // of the first diagram alone
  for (const std::size_t measure : measures) {
    const Ordinate ordinate(rows, measure, plan.laws.size());
    const study::MeasureColumn& of = study::measure_columns()[measure];
    text += scale("y", ordinate.logarithmic) +
            fmt::format("set format y '{}'\nset yrange [{:.9g}:{:.9g}]\n",
                        ordinate.logarithmic ? "10^{%T}" : "%g", ordinate.low, ordinate.high);
    for (const std::vector<double>& column : columns) {
      text +=
          diagram(plan, rows, column, measure, ordinate)
              .commands(fmt::format(
                  "set title {}\nset xlabel {}\nset ylabel {}\n",
                  gnuplot_text(measure == measures.front() ? title_of(plan, column) : ""),
                  gnuplot_text(measure == measures.back() ? plan.axes[0].name() : ""),
                  gnuplot_text(column == columns.front() ? fmt::format("{} [{}]", of.name, of.unit)
                                                         : "")));
      if (std::exchange(key, false)) text += "unset key\n";
    }
  }
  return text + "unset multiplot\n";
}

void write_sweep_page(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory) {
  const Colour shown = parse_colour(colour);
  const bool curves = shown_by_curves(plan);
  if (!curves && shown.measures.size() > 1) {
    throw diagnostics::bad_usage(
        "--colour {}: a map shows one measure; curves, over one axis, show many", colour);
  }
  if (curves && shown.certified) {
    throw diagnostics::bad_usage("--colour {}: needs a map, of two axes", colour);
  }
  const Html figure = study_figure(
      !curves ? sweep_maps(plan, rows, shown)
              : sweep_curves(plan, rows,
                             shown.measures.empty() ? std::vector{usual_measure} : shown.measures),
      directory / "map.svg", fmt::format("{} of the sweep: {}", curves ? "Curves" : "Map", colour));
  const Html axes =
      each(plan.axes, [](const Axis& axis) { return html("<li><code>{}</code></li>", axis.text); });
  const std::string how = plan.drawn > 0 ? fmt::format(", drawn with seed {}", plan.seed) : "";
  write_study_page(
      directory / "index.html", "Sweep of " + plan.name,
      html("<p class=\"lead\">{} runs{}. Every run is a row of <a "
           "href=\"results.csv\">results.csv</a>.</p>\n<ul>{}</ul>\n{}<h2>Outcomes</h2>\n{}",
           rows.size(), how, axes, figure, outcome_table(plan, rows)),
      plan.text);
}

}  // namespace tachless::report
