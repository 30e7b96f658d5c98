#include "report/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <regex>

#include "report/gnuplot.h"

namespace tachless::report {
namespace {

// Small, so that a chart on a phone is shown at nearly its size.
constexpr int width_px = 520;
constexpr int wide_px = 1064;
constexpr int usual_height_px = 300;
constexpr int bar_px = 30;  // a row of a chart of bars

std::string data_block(const std::string& name, const Curve& curve, bool positive_x,
                       bool positive_y) {
  std::string text = fmt::format("${} << END\n", name);
  for (const study::Point& point : curve.points) {
    if ((positive_y && !(point.y > 0)) || (positive_x && !(point.x > 0))) continue;
    fmt::format_to(std::back_inserter(text), "{:.8g} {:.6g}\n", point.x, point.y);
  }
  // gnuplot refuses a block without a row.
  return text + "nan nan\nEND\n";
}

std::string range(const char* axis, const std::optional<std::pair<double, double>>& limits) {
  const auto end = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.9g}", value) : "*";
  };
  if (!limits) return fmt::format("set {}range [*:*]\n", axis);
  return fmt::format("set {}range [{}:{}]\n", axis, end(limits->first), end(limits->second));
}

std::string axis_format(const char* axis, bool logarithmic) {
  return logarithmic ? fmt::format("set logscale {0}\nset format {0} '10^{{%T}}'\n", axis)
                     : fmt::format("unset logscale {0}\nset format {0} '%g'\n", axis);
}

std::string line_style(const Curve& curve) {
  const bool points = curve.style == CurveStyle::points;
  const bool steps = curve.style == CurveStyle::steps;
  return fmt::format(" with {} linewidth {:.9g}{} linecolor rgb '{}'",
                     steps    ? "fsteps"
                     : points ? "points pointtype 7 pointsize 0.3"
                              : "lines",
                     curve.width, curve.dash.empty() || points ? "" : " dashtype " + curve.dash,
                     curve.colour);
}

std::string style(int width, int height) {
  return fmt::format(
      "set terminal svg size {},{} dynamic enhanced font 'Helvetica,Arial,sans-serif,14' "
      "background '#ffffff'\n"
      "set encoding utf8\n"
      "set border 3 linecolor '#444444'\n"
      "set tics nomirror out scale 0.6 textcolor '#222222'\n"
      "set grid xtics ytics linetype 1 linewidth 0.5 linecolor '#dddddd'\n"
      "set minussign\n"
      "set xtics autofreq offset 0,0.2\nset mxtics default\n"
      "set ylabel offset 0.5,0\n"
      "set key at graph 1.0, graph 1.02 right bottom horizontal maxrows 2 reverse Left samplen "
      "2 width 0.5\n",
      width, height);
}

/// Rows from top to bottom; each stretch at least a hair wide.
std::string plot_bars(const Chart& chart) {
  const auto rows = static_cast<double>(chart.bars.size());
  const double hair = chart.x_range ? (chart.x_range->second - chart.x_range->first) / 400 : 0;
  std::vector<std::string> names;
  std::string objects;
  int object = 0;
  for (const Bars& bars : chart.bars) {
    const double y = rows - 1 - static_cast<double>(names.size());
    names.push_back(fmt::format("{} {}", gnuplot_text(bars.name), y));
    for (const auto& [from, to] : bars.stretches) {
      objects += fmt::format(
          "set object {} rectangle from {:.9g},{:.9g} to {:.9g},{:.9g} fillcolor rgb '{}' "
          "fillstyle solid noborder\n",
          ++object, from, y - 0.3, std::max(to, from + hair), y + 0.3, bars.colour);
    }
  }
  std::string text = fmt::format(
      "unset key\nset ytics ({})\nset yrange [-0.6:{}]\n{}plot -10 notitle with lines\n"
      "set ytics autofreq\n",
      fmt::join(names, ", "), rows - 0.4, objects);
  for (int i = 1; i <= object; ++i) text += fmt::format("unset object {}\n", i);
  return text + "set key\n";
}

/// Horizontal lines and marks. @return what takes them away again
std::string add_arrows(const Chart& chart, std::string& text) {
  std::string undone;
  int arrow = 0;
  const auto add = [&](const std::string& what) {
    text += fmt::format("set arrow {} {}\n", ++arrow, what);
    undone += fmt::format("unset arrow {}\n", arrow);
  };
  for (const double level : chart.levels) {
    if (chart.y_range && (level < chart.y_range->first || level > chart.y_range->second)) continue;
    add(
        fmt::format("from graph 0, first {0:.9g} to graph 1, first {0:.9g} nohead linewidth 1.2 "
                    "dashtype (2,3) linecolor '#555555'",
                    level));
  }
  for (const Mark& mark : chart.marks) {
    add(
        fmt::format("from first {:.9g}, graph 0.985 to first {:.9g}, graph 0.985 nohead "
                    "linewidth 5 linecolor '{}' front",
                    mark.from, mark.to, mark.colour));
  }
  return undone;
}

/// The range of the ordinate: that of the chart, or one whose numbers need four digits at most, or
/// gnuplot's.
std::string y_range(const Chart& chart) {
  constexpr double narrowest = 2e-3;  // of the largest value
  double low = INFINITY, high = -INFINITY;
  for (const Curve& curve : chart.curves) {
    for (const study::Point& point : curve.points) {
      if (!std::isfinite(point.y)) continue;
      low = std::min(low, point.y);
      high = std::max(high, point.y);
    }
  }
  const double least = narrowest * std::max(std::abs(low), std::abs(high));
  if (chart.y_range || chart.logarithmic_y || !(high >= low) || high - low >= least) {
    return range("y", chart.y_range);
  }
  const double centre = (low + high) / 2;
  return range("y", {{centre - least / 2, centre + least / 2}});
}

enum class TimeTics { shown, hidden };

std::string plot(const Chart& chart, const std::string& prefix, TimeTics tics = TimeTics::shown) {
  std::string text = axis_format("x", chart.logarithmic_x) + axis_format("y", chart.logarithmic_y) +
                     (tics == TimeTics::hidden ? "set format x ''\n" : "") +
                     range("x", chart.x_range) + y_range(chart) +
                     fmt::format("set xlabel {} offset 0,0.3\nset ylabel {}\n",
                                 gnuplot_text(chart.x_label), gnuplot_string(chart.y_label));
  if (!chart.bars.empty()) return text + plot_bars(chart);

  std::vector<std::string> curves;
  for (const Curve& curve : chart.curves) {
    const std::string block = prefix + std::to_string(curves.size());
    text += data_block(block, curve, chart.logarithmic_x, chart.logarithmic_y);
    curves.push_back(
        fmt::format("${}{} {}", block, line_style(curve),
                    curve.title.empty() ? "notitle" : "title " + gnuplot_string(curve.title)));
  }
  text += chart.note.empty() ? "unset label 2\n"
                             : fmt::format(
                                   "set label 2 {} at graph 0.99, graph 0.92 right font ',12' "
                                   "textcolor '#555555' front\n",
                                   gnuplot_text(chart.note));
  const std::string undone = add_arrows(chart, text);
  if (!has_something(chart)) {
    // gnuplot refuses to find a range in nothing.
    text += chart.logarithmic_x ? "set xrange [1:10]\n" : "";
    text += "set yrange [0.1:1]\n";
    curves = {"10 notitle"};
  }
  return fmt::format("{}plot {}\n{}", text, fmt::join(curves, ", "), undone);
}

int height_of(const Chart& chart) {
  if (chart.height_px > 0) return chart.height_px;
  if (!chart.bars.empty()) return 60 + bar_px * static_cast<int>(chart.bars.size());
  return usual_height_px;
}

/// Rows that the curves' titles take above a chart of that width [px].
int key_rows(const Chart& chart, double width) {
  static const std::regex markup(R"(\{/\S* |[{}_^\\])");
  constexpr double letter_px = 8, line_px = 50;  // of the font, and of a line with its gaps
  double titles = 0, longest = 0;
  for (const Curve& curve : chart.curves) {
    if (curve.title.empty()) continue;
    const std::string shown = std::regex_replace(curve.title, markup, "");
    const auto letters = std::count_if(shown.begin(), shown.end(),
                                       [](char c) { return (c & 0xc0) != 0x80; });  // UTF-8
    longest = std::max(longest, static_cast<double>(letters));
    ++titles;
  }
  const double columns = std::max(1.0, std::floor(width / (letter_px * longest + line_px)));
  return std::max(1, static_cast<int>(std::ceil(titles / columns)));
}

/// Charts that stand side by side.
using Row = std::vector<const Chart*>;

std::vector<Row> rows_of(const std::vector<Chart>& charts) {
  const auto narrow =
      std::count_if(charts.begin(), charts.end(), [](const Chart& chart) { return !chart.wide; });
  const std::size_t columns = narrow > 3 ? 2 : 1;
  std::vector<Row> rows;
  for (const Chart& chart : charts) {
    const bool joins =
        !rows.empty() && !chart.wide && !rows.back().front()->wide && rows.back().size() < columns;
    if (!joins) rows.emplace_back();
    rows.back().push_back(&chart);
  }
  return rows;
}

}  // namespace

std::string colour_of(std::size_t curve) { return palette[curve % palette.size()]; }

std::string dash_of(std::size_t curve) {
  constexpr std::array<const char*, 4> dashes = {"", "(8,3)", "(3,2)", "(8,3,2,3)"};
  return dashes[curve / palette.size() % dashes.size()];
}

bool has_something(const Chart& chart) {
  const auto shown = [&](const study::Point& point) {
    return std::isfinite(point.y) && (!chart.logarithmic_y || point.y > 0) &&
           (!chart.logarithmic_x || point.x > 0);
  };
  return !chart.bars.empty() ||
         std::any_of(chart.curves.begin(), chart.curves.end(), [&](const Curve& curve) {
           return std::any_of(curve.points.begin(), curve.points.end(), shown);
         });
}

std::string chart_commands(const std::vector<Chart>& charts,
                           const std::filesystem::path& directory) {
  std::string text;
  for (std::size_t i = 0; i < charts.size(); ++i) {
    const Chart& chart = charts[i];
    text += style(chart.wide ? wide_px : width_px, height_of(chart)) +
            fmt::format("set output {}\n{}unset output\n",
                        gnuplot_string((directory / (chart.name + ".svg")).string()),
                        plot(chart, fmt::format("c{}_", i)));
  }
  return text;
}

std::string stacked_chart_commands(const std::vector<Chart>& charts, const std::string& title,
                                   const std::filesystem::path& svg) {
  constexpr int title_px = 30;
  constexpr int key_px = 24;  // above each chart, with one row of titles
  constexpr int key_row_px = 21;
  constexpr int below_px = 14;  // below each chart
  constexpr int tics_px = 24;   // below those that show times
  constexpr int label_px = 26;  // below the last
  constexpr double stack_px = 900;
  constexpr double left_px = 104, right_px = 20;
  const std::vector<Row> rows = rows_of(charts);
  std::vector<int> tops = {title_px};
  std::size_t columns = 1;
  for (const Row& row : rows) columns = std::max(columns, row.size());
  const auto columns_of = [&](std::size_t row) { return rows[row].front()->wide ? 1 : columns; };
  const auto shows_times = [&](std::size_t row) {
    return row + 1 == rows.size() || rows[row].size() > rows[row + 1].size() ||
           columns_of(row) != columns_of(row + 1);
  };
  const auto cell_of = [&](std::size_t row) {
    return stack_px / static_cast<double>(columns_of(row));
  };
  std::vector<int> keys;  // rows of titles above each row of charts
  for (std::size_t i = 0; i < rows.size(); ++i) {
    int height = 0, titles = 1;
    for (const Chart* chart : rows[i]) {
      height = std::max(height, height_of(*chart));
      titles = std::max(titles, key_rows(*chart, cell_of(i) - left_px - right_px));
    }
    keys.push_back(titles);
    tops.push_back(tops.back() + height + key_row_px * (titles - 1) +
                   (shows_times(i) ? tics_px : 0));
  }
  const double height = tops.back() + label_px;
  // Placed by hand: gnuplot's own layout gives charts with wide tic labels less width, and their
  // time axes would not line up.
  std::string text = style(static_cast<int>(stack_px), static_cast<int>(height)) +
                     fmt::format(
                         "set output {}\nset multiplot\n"
                         "set label 1 {} at screen 0.012, screen {:.9g} left font ',15' front\n",
                         gnuplot_string(svg.string()), gnuplot_text(title), 1 - 15 / height);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double cell = cell_of(i);
    const int top = tops[i] + key_px + key_row_px * (keys[i] - 1);
    const int bottom = tops[i + 1] - below_px - (shows_times(i) ? tics_px : 0);
    for (std::size_t column = 0; column < rows[i].size(); ++column) {
      Chart chart = *rows[i][column];
      if (i + 1 != rows.size()) chart.x_label.clear();
      const double left = static_cast<double>(column) * cell;
      text += fmt::format(
          "set lmargin at screen {:.9g}\nset rmargin at screen {:.9g}\n"
          "set tmargin at screen {:.9g}\nset bmargin at screen {:.9g}\nset key maxrows {}\n{}unset "
          "label 1\n",
          (left + left_px) / stack_px, (left + cell - right_px) / stack_px, 1 - top / height,
          1 - bottom / height, keys[i],
          plot(chart, fmt::format("c{}_{}_", i, column),
               shows_times(i) ? TimeTics::shown : TimeTics::hidden));
    }
  }
  return text + "unset multiplot\nunset output\n";
}

std::optional<double> logarithmic_floor(const std::vector<Curve>& curves) {
  std::vector<double> values;
  for (const Curve& curve : curves) {
    for (const study::Point& point : curve.points) {
      if (point.y > 0 && std::isfinite(point.y)) values.push_back(point.y);
    }
  }
  if (values.empty()) return {};
  const auto quantile = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 50);
  std::nth_element(values.begin(), quantile, values.end());
  return std::pow(10, std::floor(std::log10(*quantile) - 0.3));
}

}  // namespace tachless::report
