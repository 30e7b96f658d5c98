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

/// Charts as data, without knowledge of runs. figure.h and the page's script draw them.
namespace tachless::report {

/// Okabe and Ito's palette, distinguishable with any colour vision.
inline constexpr std::array<const char*, 7> palette = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                                       "#E69F00", "#56B4E9", "#000000"};

/// The name of an axis or a curve as plain text, for example |q|, index 1, "shoulder", [rad].
struct Label {
  std::string symbol;  ///< set in italics
  std::string index;   ///< set below the symbol
  std::string text;    ///< set after the symbol
  std::string unit;
  bool magnitude = false;  ///< bars around the symbol

  [[nodiscard]] bool empty() const { return symbol.empty() && text.empty() && unit.empty(); }
};

/// Returns a label of words alone.
Label words(std::string text, std::string unit = "");

/// Returns a label with a symbol of a joint and the joint's name. A long name is shortened to its
/// end. Joint numbers count from 0.
Label of_joint(std::string symbol, std::size_t joint, std::string_view name = {},
               std::string unit = "");

Html html_of(const Label& label);

enum class Marker { none, dot, ring, cross, square };

/// A curve of a chart, with its style.
struct Curve {
  Label label;  ///< label in the legend; empty: no entry
  std::vector<study::Point> points;
  std::string colour;            ///< "#0072B2"
  double width = 1.4;            ///< line width [px]; 0: no line
  std::vector<int> dash = {};    ///< lengths of dashes and gaps [px]; empty: solid
  std::size_t run = 0;           ///< number of the curve's run if several runs are overlaid
  std::string signal = {};       ///< signal that it shows, "q" or "q_ref", if there is no label
  Marker marker = Marker::none;  ///< drawn at each point
};

/// Return the style of a curve by its number: seven colours, then dashed lines, 28 styles in all.
std::string colour_of(std::size_t curve);
std::vector<int> dash_of(std::size_t curve);

/// An interval of the abscissa, marked by a bar at the top edge.
struct Mark {
  double from = 0, to = 0;
  std::string colour;
};

/// A rectangle of a map, or a dot if its width is zero.
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

/// A diagram: axes and the curves, cells and marks between them.
struct Chart {
  std::string name;     ///< anchor in a page; letters, digits and -
  std::string caption;  ///< alternative text (screen readers)
  std::string heading;  ///< text above the chart, "Joint 1 · shoulder"
  Label x_label = words("time", "s");
  Label y_label = {};
  std::optional<std::pair<double, double>> x_range = {};
  /// An infinite end is replaced by the end of the curves' range.
  std::optional<std::pair<double, double>> y_range = {};
  bool logarithmic_x = false;
  bool logarithmic_y = false;
  bool over_time = true;  ///< the abscissa is the time of a run
  std::vector<Curve> curves = {};
  std::vector<double> levels = {};  ///< horizontal lines, drawn on a page only, as marks are
  std::vector<Mark> marks = {};
  bool named_rows = false;  ///< the ordinate has no numbers; each curve is a broad row
  std::vector<Cell> cells = {};
  std::optional<ColourScale> scale = {};  ///< scale beside the chart
  std::string note = {};                  ///< text in the upper right corner
  bool wide = false;                      ///< the chart is as wide as a page or figure
  int height_px = 300;
};

/// Smallest magnitude that does not count as zero. No quantity of a robot is resolved so finely.
/// The denormal numbers to which a signal decays would give an axis no range.
inline constexpr double least_shown = 1e-30;

/// Returns whether the chart can show the point: it is finite, and positive on a logarithmic axis.
bool shown(const Chart& chart, const study::Point& point);

/// Returns whether the chart shows anything.
bool has_something(const Chart& chart);

/// Cuts the ordinate if a short peak, for example at the start of a run, would flatten the curves.
/// The axis leaves out at most the highest and the lowest 5 % of each curve's points. A note gives
/// the peak.
void cut_kick(Chart& chart, const std::string& unit);

/// Makes the ordinate logarithmic, with a floor. A curve that crosses zero has arbitrarily deep
/// dips, and they would compress everything else. There is no floor if no value is positive.
void make_logarithmic(Chart& chart);

}  // namespace tachless::report
