#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "study/envelope.h"

/// Charts as data, and the gnuplot commands that draw them: the one place that knows how a diagram
/// of this project looks. Knows nothing of runs; runs gnuplot not itself (gnuplot.h).
namespace tachless::report {

enum class CurveStyle { line, steps, points };

struct Curve {
  std::string title;  ///< in the key; empty: not there. gnuplot's enhanced text
  std::vector<study::Point> points;
  std::string colour;  ///< "#0072B2"
  double width = 1.4;  ///< [px]
  std::string dash;    ///< gnuplot's dashtype, "(6,4)"; empty: solid
  CurveStyle style = CurveStyle::line;
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
  std::string name;     ///< of its file, without ending; letters, digits and -
  std::string caption;  ///< alternative text (screen readers); plain text
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

/// gnuplot commands that draw each chart into DIRECTORY/name.svg.
std::string chart_commands(const std::vector<Chart>& charts,
                           const std::filesystem::path& directory);

/// gnuplot commands that draw all charts into one file, below each other: a wide one over the whole
/// width, more than three others in two columns. They share the time axis at their feet.
std::string stacked_chart_commands(const std::vector<Chart>& charts, const std::string& title,
                                   const std::filesystem::path& svg);

/// The lower end for a logarithmic ordinate: a curve that swings through zero dips without end, and
/// the dips would squeeze everything else. Nothing when no value is positive.
std::optional<double> logarithmic_floor(const std::vector<Curve>& curves);

}  // namespace tachless::report
