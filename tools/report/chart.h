#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "report/html.h"
#include "study/tracking.h"

/// Charts as data. Knows nothing of runs; drawn by figure.h, and by the page's script.
namespace tachless::report {

/// Okabe and Ito's palette: distinguishable with any colour vision.
inline constexpr std::array<const char*, 7> palette = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                                       "#E69F00", "#56B4E9", "#000000"};

/// What an axis or a curve is called, as plain text: |q|, index 1, "shoulder", [rad].
struct Label {
  std::string symbol;  ///< in italics
  std::string index;   ///< below it
  std::string text;    ///< after it
  std::string unit;
  bool magnitude = false;  ///< bars around the symbol

  [[nodiscard]] bool empty() const { return symbol.empty() && text.empty() && unit.empty(); }
};

/// Words alone.
Label words(std::string text, std::string unit = "");

/// A symbol of the joint with that number, from 0, and the joint's name; of a long name its end.
Label of_joint(std::string symbol, std::size_t joint, std::string_view name = {},
               std::string unit = "");

Html html_of(const Label& label);

enum class Marker { none, dot, ring, cross, square };

struct Curve {
  Label label;  ///< in the key; empty: not there
  std::vector<study::Point> points;
  std::string colour;            ///< "#0072B2"
  double width = 1.4;            ///< of the line [px]; 0: none
  std::vector<int> dash = {};    ///< lengths of dashes and gaps [px]; empty: solid
  std::size_t run = 0;           ///< its run, where several are overlaid
  std::string signal = {};       ///< what it shows where no label says it: "q", "q_ref"
  Marker marker = Marker::none;  ///< at each point
};

/// How the curve of that number is drawn among others: seven colours, then dashed, 28 in all.
std::string colour_of(std::size_t curve);
std::vector<int> dash_of(std::size_t curve);

/// A stretch of the abscissa, marked by a bar at the top edge.
struct Mark {
  double from = 0, to = 0;
  std::string colour;
};

/// A rectangle of a map; without a width, a dot.
struct Cell {
  double left = 0, right = 0, bottom = 0, top = 0;
  std::string colour;
};

/// The colours of a map's values, from blue through white to red.
struct ColourScale {
  Label label;
  double low = 0, high = 1;
  bool logarithmic = false;

  [[nodiscard]] std::string colour(double value) const;
};

/// One diagram: axes and what is drawn between them.
struct Chart {
  std::string name;     ///< of its place in a page; letters, digits and -
  std::string caption;  ///< alternative text (screen readers)
  std::string heading;  ///< above it, "Joint 1 · shoulder"
  Label x_label = words("time", "s");
  Label y_label = {};
  std::optional<std::pair<double, double>> x_range = {};
  std::optional<std::pair<double, double>> y_range = {};  ///< an infinite end: from the curves
  bool logarithmic_x = false;
  bool logarithmic_y = false;
  bool over_time = true;
  std::vector<Curve> curves = {};
  std::vector<double> levels = {};  ///< horizontal lines; on a page alone, like marks
  std::vector<Mark> marks = {};
  bool named_rows = false;  ///< no numbers at the ordinate: its curves are broad rows
  std::vector<Cell> cells = {};
  std::optional<ColourScale> scale = {};  ///< beside the chart
  std::string note = {};                  ///< in the upper right corner
  bool wide = false;                      ///< over the whole width of a page or figure
  int height_px = 300;
};

/// Smaller magnitudes count as zero: no quantity of a robot is resolved so far, and the denormal
/// numbers to which a signal decays give an axis no range.
inline constexpr double least_shown = 1e-30;

/// Whether the point has a place in the chart: finite, and positive on a logarithmic axis.
bool shown(const Chart& chart, const study::Point& point);

/// Whether there is anything to be seen in it.
bool has_something(const Chart& chart);

/// Where a kick, at the start of a run say, would flatten the rest of a chart's curves (all but the
/// highest and the lowest 5 % of each one's points), its axis is cut there, and a note gives the
/// peak.
void cut_kick(Chart& chart, const std::string& unit);

/// Makes the ordinate logarithmic, from a floor: a curve that swings through zero dips without end,
/// and the dips would squeeze everything else. No floor when no value is positive.
void make_logarithmic(Chart& chart);

}  // namespace tachless::report
