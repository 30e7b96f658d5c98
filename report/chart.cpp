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

bool shown(const Chart& chart, const study::Point& point) {
  return !(chart.logarithmic_x && !(point.x > 0)) && !(chart.logarithmic_y && !(point.y > 0));
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
  for (const Bars& bars : chart.bars) {
    const double y = rows - 1 - static_cast<double>(names.size());
    names.push_back(fmt::format("{} {}", gnuplot_text(bars.name), y));
    for (const auto& [from, to] : bars.stretches) {
      objects += fmt::format(
          "set object rectangle from {:.9g},{:.9g} to {:.9g},{:.9g} fillcolor rgb '{}' "
          "fillstyle solid noborder\n",
          from, y - 0.3, std::max(to, from + hair), y + 0.3, bars.colour);
    }
  }
  return fmt::format(
      "unset key\nset ytics ({})\nset yrange [-0.6:{}]\n{}plot -10 notitle with lines\n"
      "set ytics autofreq\nunset object\nset key\n",
      fmt::join(names, ", "), rows - 0.4, objects);
}

/// Horizontal lines and marks.
std::string arrows(const Chart& chart) {
  std::string text;
  for (const double level : chart.levels) {
    if (chart.y_range && (level < chart.y_range->first || level > chart.y_range->second)) continue;
    text += fmt::format(
        "set arrow from graph 0, first {0:.9g} to graph 1, first {0:.9g} nohead linewidth 1.2 "
        "dashtype (2,3) linecolor '#555555'\n",
        level);
  }
  for (const Mark& mark : chart.marks) {
    text += fmt::format(
        "set arrow from first {:.9g}, graph 0.985 to first {:.9g}, graph 0.985 nohead linewidth 5 "
        "linecolor '{}' front\n",
        mark.from, mark.to, mark.colour);
  }
  return text;
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

std::string plot(const Chart& chart, bool times = true) {
  std::string text = axis_format("x", chart.logarithmic_x) + axis_format("y", chart.logarithmic_y) +
                     (times ? "" : "set format x ''\n") + range("x", chart.x_range) +
                     y_range(chart) +
                     fmt::format("set xlabel {} offset 0,0.3\nset ylabel {}\n",
                                 gnuplot_text(chart.x_label), gnuplot_string(chart.y_label));
  if (!chart.bars.empty()) return text + plot_bars(chart);

  text += "unset label 2\n" + arrows(chart);
  if (!chart.note.empty()) {
    text += fmt::format(
        "set label 2 {} at graph 0.99, graph 0.92 right font ',12' textcolor '#555555' front\n",
        gnuplot_text(chart.note));
  }
  Plot curves;
  for (const Curve& curve : chart.curves) {
    std::string rows;
    for (const study::Point& point : curve.points) {
      if (!shown(chart, point)) continue;
      fmt::format_to(std::back_inserter(rows), "{:.8g} {:.6g}\n", point.x, point.y);
    }
    curves.add(rows, fmt::format(
                         "with lines linewidth {:.9g}{} linecolor rgb '{}' {}", curve.width,
                         curve.dash.empty() ? "" : " dashtype " + curve.dash, curve.colour,
                         curve.title.empty() ? "notitle" : "title " + gnuplot_string(curve.title)));
  }
  if (!has_something(chart)) {
    // gnuplot refuses to find a range in nothing.
    text += chart.logarithmic_x ? "set xrange [1:10]\n" : "";
    text += "set yrange [0.1:1]\n";
    curves = {};
    curves.add("10 notitle");
  }
  return text + curves.commands() + "unset arrow\n";
}

int height_of(const Chart& chart) {
  if (chart.height_px > 0) return chart.height_px;
  return chart.bars.empty() ? 300 : 60 + 30 * static_cast<int>(chart.bars.size());
}

/// Rows that the curves' titles take above a chart of that width [px].
int key_rows(const Chart& chart, double width) {
  static const std::regex markup(R"(\{/\S* |[{}_^\\])");
  constexpr double letter_px = 8, line_px = 50;  // of the font, and of a line with its gaps
  double titles = 0, longest = 0;
  for (const Curve& curve : chart.curves) {
    if (curve.title.empty()) continue;
    const std::string letters = std::regex_replace(curve.title, markup, "");
    const auto count = std::ranges::count_if(letters, [](char c) { return (c & 0xc0) != 0x80; });
    longest = std::max(longest, static_cast<double>(count));  // UTF-8
    ++titles;
  }
  const double columns = std::max(1.0, std::floor(width / (letter_px * longest + line_px)));
  return std::max(1, static_cast<int>(std::ceil(titles / columns)));
}

constexpr double stack_px = 900;
constexpr double left_px = 104, right_px = 20;
constexpr int key_row_px = 21;

/// Charts of a stack that stand side by side.
struct Row {
  std::vector<const Chart*> charts;
  std::size_t columns = 1;  ///< into which its width is divided
  bool shows_times = true;

  [[nodiscard]] double cell_px() const { return stack_px / static_cast<double>(columns); }
  /// Of titles, above the charts.
  [[nodiscard]] int title_rows() const {
    int most = 1;
    for (const Chart* chart : charts) {
      most = std::max(most, key_rows(*chart, cell_px() - left_px - right_px));
    }
    return most;
  }
};

std::vector<Row> rows_of(const std::vector<Chart>& charts) {
  const auto narrow = std::ranges::count(charts, false, &Chart::wide);
  const std::size_t columns = narrow > 3 ? 2 : 1;
  std::vector<Row> rows;
  for (const Chart& chart : charts) {
    const bool joins = !rows.empty() && !chart.wide && !rows.back().charts.front()->wide &&
                       rows.back().charts.size() < columns;
    if (!joins) rows.push_back({{}, chart.wide ? 1 : columns});
    rows.back().charts.push_back(&chart);
  }
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    rows[i].shows_times =
        rows[i].charts.size() > rows[i + 1].charts.size() || rows[i].columns != rows[i + 1].columns;
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
  return !chart.bars.empty() || std::ranges::any_of(chart.curves, [&](const Curve& curve) {
    return std::ranges::any_of(curve.points, [&](const study::Point& point) {
      return std::isfinite(point.y) && shown(chart, point);
    });
  });
}

void cut_kick(Chart& chart, const std::string& unit) {
  constexpr double kick = 0.05;  // of the points, at most, at either end of the values
  struct Range {
    double low = INFINITY, high = -INFINITY;
    void join(double from, double to) {
      low = std::min(low, from);
      high = std::max(high, to);
    }
    [[nodiscard]] double span() const { return high - low; }
  } whole, usual;
  for (const Curve& curve : chart.curves) {
    std::vector<double> values;
    for (const study::Point& point : curve.points) values.push_back(point.y);
    if (values.empty()) values = {0};
    std::ranges::sort(values);
    const auto skip = static_cast<std::size_t>(kick * static_cast<double>(values.size()));
    whole.join(values.front(), values.back());
    usual.join(values[skip], values[values.size() - 1 - skip]);
  }
  if (!(usual.span() > 0) || whole.span() <= 4 * usual.span()) return;
  const double margin = usual.span() / 4;
  chart.y_range = {{usual.low - margin, usual.high + margin}};
  chart.note = fmt::format("axis cut: peak {:.4g} {}",
                           std::max(std::abs(whole.low), std::abs(whole.high)), unit);
}

void make_logarithmic(Chart& chart) {
  chart.logarithmic_y = true;
  std::vector<double> values;
  for (const Curve& curve : chart.curves) {
    for (const study::Point& point : curve.points) {
      if (point.y > 0 && std::isfinite(point.y)) values.push_back(point.y);
    }
  }
  if (values.empty()) return;
  const auto quantile = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 50);
  std::nth_element(values.begin(), quantile, values.end());
  chart.y_range = {{std::pow(10, std::floor(std::log10(*quantile) - 0.3)), INFINITY}};
}

std::string chart_commands(const std::vector<Chart>& charts) {
  std::string text;
  for (const Chart& chart : charts) {
    // Narrow, so that a chart on a phone is shown at nearly its size.
    text += style(chart.wide ? 1064 : 520, height_of(chart)) + plot(chart);
  }
  return text;
}

std::string stacked_chart_commands(const std::vector<Chart>& charts, const std::string& title) {
  constexpr int title_px = 30;
  constexpr int key_px = 24;    // above each chart, with one row of titles
  constexpr int below_px = 14;  // below each chart
  constexpr int tics_px = 24;   // below those that show times
  constexpr int label_px = 26;  // below the last
  const std::vector<Row> rows = rows_of(charts);
  std::vector<int> tops = {title_px};
  for (const Row& row : rows) {
    int height = 0;
    for (const Chart* chart : row.charts) height = std::max(height, height_of(*chart));
    tops.push_back(tops.back() + height + key_row_px * (row.title_rows() - 1) +
                   (row.shows_times ? tics_px : 0));
  }
  const double height = tops.back() + label_px;
  // Placed by hand: gnuplot's own layout gives charts with wide tic labels less width, and their
  // time axes would not line up.
  std::string text = style(static_cast<int>(stack_px), static_cast<int>(height)) +
                     fmt::format(
                         "set multiplot\n"
                         "set label 1 {} at screen 0.012, screen {:.9g} left font ',15' front\n",
                         gnuplot_text(title), 1 - 15 / height);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const int top = tops[i] + key_px + key_row_px * (row.title_rows() - 1);
    const int bottom = tops[i + 1] - below_px - (row.shows_times ? tics_px : 0);
    double left = 0;
    for (const Chart* each : row.charts) {
      Chart chart = *each;
      if (i + 1 != rows.size()) chart.x_label.clear();
      text += fmt::format(
          "set lmargin at screen {:.9g}\nset rmargin at screen {:.9g}\n"
          "set tmargin at screen {:.9g}\nset bmargin at screen {:.9g}\nset key maxrows {}\n{}unset "
          "label 1\n",
          (left + left_px) / stack_px, (left + row.cell_px() - right_px) / stack_px,
          1 - top / height, 1 - bottom / height, row.title_rows(), plot(chart, row.shows_times));
      left += row.cell_px();
    }
  }
  return text + "unset multiplot\n";
}

}  // namespace tachless::report
