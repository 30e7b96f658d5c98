#include "report/sweep_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "certificate/parallel.h"
#include "certificate/stability_certificate.h"
#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "report/gnuplot.h"
#include "report/plain_page.h"
#include "report/sweep_curves.h"
#include "study/measures.h"

namespace tachless::report {
namespace {

using study::Axis;
using study::SweepPlan;
using study::SweepRow;

constexpr std::size_t usual_measure = 1;  // rms_error

struct OutcomeColour {
  std::string_view outcome, colour;
};
/// From the best to the worst.
constexpr std::array outcome_colours = {
    OutcomeColour{"converged", "#009E73"},   OutcomeColour{"followed", "#56B4E9"},
    OutcomeColour{"not_judged", "#BBBBBB"},  OutcomeColour{"saturated", "#E69F00"},
    OutcomeColour{"limit_cycle", "#CC79A7"}, OutcomeColour{"diverging", "#D55E00"},
    OutcomeColour{"stopped", "#000000"}};

std::size_t severity(std::string_view outcome) {
  const auto found = std::ranges::find(outcome_colours, outcome, &OutcomeColour::outcome);
  return static_cast<std::size_t>(found - outcome_colours.begin());
}

/// What --colour asks for.
struct Colour {
  std::vector<std::size_t> measures;  ///< indices into `measure_columns`; empty: outcomes
  bool certified = false;             ///< which initial states are certified, too
};

diagnostics::Failure refused(const std::string& colour, const std::string& problem) {
  return {diagnostics::ExitCode::bad_usage, fmt::format("--colour {}: {}", colour, problem)};
}

/// @throw diagnostics::Failure(bad_usage) when there is no such measure
Colour colour_of(const std::string& text) {
  Colour colour;
  if (text == "outcome") return colour;
  colour.certified = text == "certified";
  if (colour.certified) return colour;
  std::vector<std::string_view> names = {"outcome", "certified"};
  const std::size_t others = names.size();
  for (const study::MeasureColumn& column : study::measure_columns()) names.push_back(column.name);
  for (std::size_t from = 0; from <= text.size();) {
    const std::size_t to = std::min(text.find(',', from), text.size());
    const auto found = std::find(names.begin() + others, names.end(), text.substr(from, to - from));
    if (found == names.end()) {
      throw refused(text, "no measure; allowed: " + diagnostics::joined(names));
    }
    colour.measures.push_back(static_cast<std::size_t>(found - names.begin()) - others);
    from = to + 1;
  }
  return colour;
}

/// Of each row, whether the initial state of its run is certified (certificate/).
std::vector<bool> certified_rows(const SweepPlan& plan, const std::vector<SweepRow>& rows) {
  std::vector<char> certified(rows.size());
  certificate::parallel_for(rows.size(), [&](std::size_t i) {
    const auto run = certificate::certified_run(plan.scenario(rows[i].which));
    certified[i] = run && run->rate >= 0 ? 1 : 0;
  });
  return {certified.begin(), certified.end()};
}

/// What a place on the map shows: of several runs the worst outcome, the largest measure.
struct Shown {
  std::size_t outcome = 0;
  double measure = NAN;
  bool certified = true;
};
using Places = std::map<std::pair<double, double>, Shown>;

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

class Map {
 public:
  /// @param certified of each row; empty: it is not asked for
  Map(const SweepPlan& plan, const std::vector<SweepRow>& rows, std::optional<std::size_t> column,
      const std::vector<bool>& certified)
      : plan_(plan),
        column_(column),
        one_axis_(plan.axes.size() == 1),
        certified_(!certified.empty()) {
    const std::size_t ordinate = column.value_or(usual_measure);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const SweepRow& row = rows[i];
      const double measure = row.measures[ordinate];
      const double y = one_axis_ ? measure : row.which.values[1];
      if (!std::isfinite(y)) continue;
      Shown& shown = places_[row.which.law][{row.which.values[0], y}];
      shown.outcome = std::max(shown.outcome, severity(row.outcome));
      shown.certified = shown.certified && certified_ && certified[i];
      shown.measure = std::isnan(shown.measure) ? measure : std::max(shown.measure, measure);
      if (measure > 0) lowest_ = std::min(lowest_, measure);
      if (std::isfinite(measure)) highest_ = std::max(highest_, measure);
      positive_ = positive_ && !(measure <= 0);
    }
  }

  /// gnuplot's commands for all laws.
  [[nodiscard]] std::string commands(const std::filesystem::path& svg) const {
    const std::size_t laws = plan_.laws.size(), columns = std::min<std::size_t>(laws, 3);
    const std::size_t rows = (laws + columns - 1) / columns;
    std::string text = fmt::format(
        "set terminal svg size {},{} font 'sans,11' background '#ffffff'\nset output {}\n"
        "set multiplot layout {},{} title {} font ',14'\nset key below horizontal samplen 1 height "
        "0.7\n"
        "set border 3\nset tics nomirror\n",
        columns == 1 ? 720 : 480 * columns, 430 * rows + 30, gnuplot_string(svg.string()), rows,
        columns, gnuplot_text(plan_.name));
    const auto logarithmic = [&](const char* axis, bool is) {
      text += fmt::format("{}set logscale {}\n", is ? "" : "un", axis);
    };
    const bool wide = positive_ && highest_ > 100 * lowest_;
    const std::string measured =
        std::string(study::measure_columns()[column_.value_or(usual_measure)].name);
    logarithmic("x", plan_.axes[0].logarithmic);
    logarithmic("y", one_axis_ ? wide : plan_.axes[1].logarithmic);
    logarithmic("cb", wide);
    text += fmt::format(
        "set xlabel {}\nset ylabel {}\nset cblabel {}\n", gnuplot_text(plan_.axes[0].name()),
        gnuplot_text(one_axis_ ? measured : plan_.axes[1].name()), gnuplot_text(measured));
    const auto range = [&](const char* axis, const Axis& of) {
      double low = of.low, high = of.high;
      for (const double value : of.values) {
        const auto [from, to] = extent(of, value);
        low = value == of.values.front() ? from : std::min(low, from);
        high = value == of.values.front() ? to : std::max(high, to);
      }
      if (low < high) text += fmt::format("set {}range [{:.9g}:{:.9g}]\n", axis, low, high);
    };
    range("x", plan_.axes[0]);
    if (!one_axis_) {
      range("y", plan_.axes[1]);
    } else if (lowest_ < highest_) {
      text +=
          fmt::format("set yrange [{:.9g}:{:.9g}]\n", wide ? 0.8 * lowest_ : 0.0, 1.1 * highest_);
    }
    // From blue through white to red, told apart by people with any colour vision.
    text += "set palette defined (0 '#2166AC', 0.5 '#F7F7F7', 1 '#B2182B')\n";
    for (const study::SweepLaw& law : plan_.laws) text += panel(law.name);
    return text + "unset multiplot\n";
  }

 private:
  [[nodiscard]] std::string place(const std::pair<double, double>& at, const Shown& shown) const {
    const auto [x, y] = at;
    if (one_axis_ || plan_.drawn > 0)
      return fmt::format("{:.9g} {:.9g} {:.9g}\n", x, y, shown.measure);
    const auto [left, right] = extent(plan_.axes[0], x);
    const auto [low, high] = extent(plan_.axes[1], y);
    return fmt::format("{:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g}\n", x, y, left, right, low,
                       high, shown.measure);
  }

  [[nodiscard]] std::string panel(const std::string& law) const {
    const bool points = one_axis_ || plan_.drawn > 0;
    const bool by_measure = column_ && !one_axis_;
    std::map<std::size_t, std::string> data;
    for (const auto& [at, shown] : places_.at(law)) {
      if (by_measure && std::isnan(shown.measure)) continue;
      data[by_measure ? 0 : shown.outcome] += place(at, shown);
    }
    std::string blocks, certified;
    std::vector<std::string> plots;
    for (const auto& [at, shown] : places_.at(law)) {
      if (shown.certified) certified += fmt::format("{:.9g} {:.9g}\n", at.first, at.second);
    }
    for (const auto& [outcome, lines] : data) {
      blocks += fmt::format("$data{} << EOD\n{}EOD\n", outcome, lines);
      const std::string colour =
          by_measure ? "palette" : fmt::format("rgb '{}'", outcome_colours[outcome].colour);
      plots.push_back(fmt::format(
          "$data{} using {} with {} lc {} {}", outcome,
          points ? (by_measure ? "1:2:3" : "1:2") : (by_measure ? "1:2:3:4:5:6:7" : "1:2:3:4:5:6"),
          points ? "points pt 7 ps 0.6" : "boxxyerror fs solid noborder", colour,
          by_measure ? "notitle" : "title " + gnuplot_text(outcome_colours[outcome].outcome)));
    }
    if (!certified.empty()) {
      blocks += fmt::format("$certified << EOD\n{}EOD\n", certified);
      plots.emplace_back("$certified with points pt 7 ps 0.4 lc rgb '#ffffff' notitle");
      plots.emplace_back("NaN with points pt 6 ps 0.6 lc rgb '#444444' title 'certified'");
    }
    if (plots.empty())
      return fmt::format("set title {}\nplot [0:1][0:1] NaN notitle\n", gnuplot_text(law));
    return blocks +
           fmt::format("set title {}\nplot {}\n", gnuplot_text(law), fmt::join(plots, ", "));
  }

  const SweepPlan& plan_;
  std::optional<std::size_t> column_;
  bool one_axis_, certified_, positive_ = true;
  double lowest_ = INFINITY, highest_ = -INFINITY;
  std::map<std::string, Places> places_;  ///< by law
};

/// How many runs of each law ended how.
Html outcome_table(const SweepPlan& plan, const std::vector<SweepRow>& rows) {
  std::map<std::string, std::map<std::string, int>> count;
  for (const SweepRow& row : rows) ++count[row.which.law][row.outcome];
  Html head, body;
  for (const auto& [outcome, colour] : outcome_colours) head += html("<th>{}</th>", outcome);
  for (const study::SweepLaw& law : plan.laws) {
    Html cells;
    for (const auto& [outcome, colour] : outcome_colours) {
      cells += html("<td>{}</td>", count[law.name][std::string(outcome)]);
    }
    body += html("<tr><th>{}</th>{}<td>{}</td></tr>\n", law.name, cells,
                 diagnostics::joined(law.overrides, "; "));
  }
  return html("<table><tr><th>law</th>{}<th>set</th></tr>\n{}</table>\n", head, body);
}

}  // namespace

void write_sweep_page(const SweepPlan& plan, const std::vector<SweepRow>& rows,
                      const std::string& colour, const std::filesystem::path& directory) {
  const Colour shown = colour_of(colour);
  const bool curves = shown_by_curves(plan);
  if (!curves && shown.measures.size() > 1) {
    throw refused(colour, "a map shows one measure; curves, over one axis, show many");
  }
  if (curves && shown.certified) {
    throw refused(colour, "needs a map, of two axes");
  }
  const Html figure = drawn_figure(
      directory / "map.svg",
      [&](const auto& svg) {
        if (curves) {
          return sweep_curves(plan, rows,
                              shown.measures.empty() ? std::vector{usual_measure} : shown.measures,
                              svg);
        }
        return Map(plan, rows,
                   shown.measures.empty() ? std::optional<std::size_t>() : shown.measures.front(),
                   shown.certified ? certified_rows(plan, rows) : std::vector<bool>())
            .commands(svg);
      },
      fmt::format("{} of the sweep: {}", curves ? "Curves" : "Map", colour));
  Html axes;
  for (const Axis& axis : plan.axes) axes += html("<li><code>{}</code></li>", axis.text);
  const std::string how = plan.drawn > 0 ? fmt::format(", drawn with seed {}", plan.seed) : "";
  write_plain_page(
      directory / "index.html", "Sweep of " + plan.name,
      html("<p class=\"lead\">{} runs{}. Every run is a row of <a "
           "href=\"results.csv\">results.csv</a>.</p>\n<ul>{}</ul>\n{}<h2>Outcomes</h2>\n{}",
           rows.size(), how, axes, figure, outcome_table(plan, rows)),
      plan.text);
}

}  // namespace tachless::report
