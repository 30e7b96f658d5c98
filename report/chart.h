#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "study/envelope.h"

/// Charts as data, and the gnuplot commands that draw them: the one place that knows how a diagram
/// of this project looks. Knows nothing of runs; runs gnuplot not itself (gnuplot.h).
namespace tachless::report {

struct Curve {
  std::string title;  ///< in the key; empty: not there. gnuplot's enhanced text
  std::vector<study::Point> points;
  std::string colour;       ///< "#0072B2"
  double width = 1.4;       ///< [px]
  std::string dash;         ///< gnuplot's dashtype, "(6,4)"; empty: solid
  std::size_t run = 0;      ///< whose, where several runs are overlaid
  std::string signal = {};  ///< what it shows where no title says it: "q", "q_ref"; plain text
};

/// How the curve of that number is drawn among others: seven colours, then dashed, 28 in all.
std::string colour_of(std::size_t curve);
std::string dash_of(std::size_t curve);

/// A stretch of the abscissa, marked by a bar at the top edge.
struct Mark {
  double from = 0, to = 0;
  std::string colour;
};

/// One row of a chart whose ordinate is a list of names: bars where something was the case.
struct Bars {
  std::string name;
  std::vector<std::pair<double, double>> stretches;
  std::string colour;
};

/// One diagram: axes and what is drawn between them.
struct Chart {
  std::string name;     ///< of its place in a page; letters, digits and -
  std::string caption;  ///< alternative text (screen readers); plain text
  std::string heading;  ///< above it in a page, "Joint 1 · shoulder"; plain text
  std::size_t run = 0;  ///< whose, where a chart is of one run
  std::string x_label = "time [s]";
  std::string y_label;  ///< gnuplot's enhanced text
  std::optional<std::pair<double, double>> x_range;
  std::optional<std::pair<double, double>> y_range;
  bool logarithmic_x = false;
  bool logarithmic_y = false;
  std::vector<Curve> curves;
  std::vector<double> levels;  ///< horizontal lines
  std::vector<Mark> marks;
  std::vector<Bars> bars;  ///< in place of curves
  std::string note;        ///< in the upper right corner; plain text
  bool wide = false;       ///< over the whole width of a page
  int height_px = 0;       ///< 0: as usual

  [[nodiscard]] bool over_time() const { return x_label == "time [s]"; }
};

/// Whether there is anything to be seen in it.
bool has_something(const Chart& chart);

/// Where a kick, at the start of a run say, would flatten the rest of a chart's curves (all but the
/// highest and the lowest 5 % of each one's points), its axis is cut there, and a note tells the
/// peak.
void cut_kick(Chart& chart, const std::string& unit);

/// Makes the ordinate logarithmic, from a floor: a curve that swings through zero dips without end,
/// and the dips would squeeze everything else. No floor when no value is positive.
void make_logarithmic(Chart& chart);

/// gnuplot commands that draw each chart, a picture of its own.
std::string chart_commands(const std::vector<Chart>& charts);

/// gnuplot commands that draw all charts into one picture, below each other: a wide one over the
/// whole width, more than three others in two columns. They share the time axis at their feet.
std::string stacked_chart_commands(const std::vector<Chart>& charts, const std::string& title);

}  // namespace tachless::report
