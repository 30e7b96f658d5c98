#include "report/chart.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

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
  std::string text = "$" + name + " << END\n";
  char row[64];
  for (const Point& point : curve.points) {
    if ((positive_y && !(point.y > 0)) || (positive_x && !(point.x > 0))) continue;
    std::snprintf(row, sizeof row, "%.8g %.6g\n", point.x, point.y);
    text += row;
  }
  // gnuplot refuses a block without a row.
  return text + "nan nan\nEND\n";
}

std::string range(const char* axis, const std::optional<std::pair<double, double>>& limits) {
  const std::string name = std::string("set ") + axis + "range ";
  if (!limits) return name + "[*:*]\n";
  const auto end = [](double value) { return std::isfinite(value) ? gnuplot_number(value) : "*"; };
  return name + "[" + end(limits->first) + ":" + end(limits->second) + "]\n";
}

std::string axis_format(const char* axis, bool logarithmic) {
  return logarithmic ? std::string("set logscale ") + axis + "\nset format " + axis + " '10^{%T}'\n"
                     : std::string("unset logscale ") + axis + "\nset format " + axis + " '%g'\n";
}

std::string line_style(const Curve& curve) {
  std::string text = curve.style == CurveStyle::steps    ? " with fsteps"
                     : curve.style == CurveStyle::points ? " with points pointtype 7 pointsize 0.3"
                                                         : " with lines";
  text += " linewidth " + gnuplot_number(curve.width);
  if (!curve.dash.empty() && curve.style != CurveStyle::points) text += " dashtype " + curve.dash;
  return text + " linecolor rgb '" + curve.colour + "'";
}

std::string style(const std::string& size) {
  return "set terminal svg size " + size +
         " dynamic enhanced font 'Helvetica,Arial,sans-serif,14' background '#ffffff'\n"
         "set encoding utf8\n"
         "set border 3 linecolor '#444444'\n"
         "set tics nomirror out scale 0.6 textcolor '#222222'\n"
         "set grid xtics ytics linetype 1 linewidth 0.5 linecolor '#dddddd'\n"
         "set minussign\n"
         "set xtics autofreq offset 0,0.2\nset mxtics default\n"
         "set ylabel offset 0.5,0\n"
         "set key at graph 1.0, graph 1.02 right bottom horizontal maxrows 2 reverse Left samplen "
         "2 width 0.5\n";
}

std::string plot_bars(const Chart& chart) {
  // Rows from top to bottom; each stretch at least a hair wide.
  const auto rows = static_cast<double>(chart.bars.size());
  const double hair = chart.x_range ? (chart.x_range->second - chart.x_range->first) / 400 : 0;
  std::string text = "unset key\nset ytics (";
  std::string objects;
  int object = 0;
  for (std::size_t i = 0; i < chart.bars.size(); ++i) {
    const double y = rows - 1 - static_cast<double>(i);
    text += (i == 0 ? "" : ", ") + gnuplot_text(chart.bars[i].name) + " " + gnuplot_number(y);
    for (const auto& [from, to] : chart.bars[i].stretches) {
      objects += "set object " + std::to_string(++object) + " rectangle from " +
                 gnuplot_number(from) + "," + gnuplot_number(y - 0.3) + " to " +
                 gnuplot_number(std::max(to, from + hair)) + "," + gnuplot_number(y + 0.3) +
                 " fillcolor rgb '" + chart.bars[i].colour + "' fillstyle solid noborder\n";
    }
  }
  text += ")\nset yrange [-0.6:" + gnuplot_number(rows - 0.4) + "]\n" + objects;
  text += "plot " + gnuplot_number(-10) + " notitle with lines\n";
  text += "set ytics autofreq\n";
  for (int i = 1; i <= object; ++i) text += "unset object " + std::to_string(i) + "\n";
  return text + "set key\n";
}

bool shows_anything(const Chart& chart) {
  const auto shown = [&](const Point& point) {
    return std::isfinite(point.y) && (!chart.logarithmic_y || point.y > 0) &&
           (!chart.logarithmic_x || point.x > 0);
  };
  return std::any_of(chart.curves.begin(), chart.curves.end(), [&](const Curve& curve) {
    return std::any_of(curve.points.begin(), curve.points.end(), shown);
  });
}

std::string plot(const Chart& chart, const std::string& prefix) {
  std::string text = axis_format("x", chart.logarithmic_x) + axis_format("y", chart.logarithmic_y) +
                     range("x", chart.x_range) + range("y", chart.y_range) + "set xlabel " +
                     gnuplot_text(chart.x_label) + " offset 0,0.3\n" + "set ylabel " +
                     gnuplot_string(chart.y_label) + "\n";
  if (!chart.bars.empty()) return text + plot_bars(chart);

  std::string curves;
  for (std::size_t i = 0; i < chart.curves.size(); ++i) {
    const Curve& curve = chart.curves[i];
    const std::string block = prefix + std::to_string(i);
    text += data_block(block, curve, chart.logarithmic_x, chart.logarithmic_y);
    curves += (curves.empty() ? "plot $" : ", $") + block + line_style(curve) +
              (curve.title.empty() ? " notitle" : " title " + gnuplot_string(curve.title));
  }
  text += chart.note.empty() ? "unset label 2\n"
                             : "set label 2 " + gnuplot_text(chart.note) +
                                   " at graph 0.99, graph 0.92 right font ',12' textcolor "
                                   "'#555555' front\n";
  int arrow = 0;
  for (const double level : chart.levels) {
    if (chart.y_range && (level < chart.y_range->first || level > chart.y_range->second)) continue;
    const std::string y = gnuplot_number(level);
    text += "set arrow " + std::to_string(++arrow) + " from graph 0, first " + y +
            " to graph 1, first " + y +
            " nohead linewidth 1.2 dashtype (2,3) linecolor '#555555'\n";
  }
  for (const Mark& mark : chart.marks) {
    text += "set arrow " + std::to_string(++arrow) + " from first " + gnuplot_number(mark.from) +
            ", graph 0.985 to first " + gnuplot_number(mark.to) +
            ", graph 0.985 nohead linewidth 5 linecolor '" + mark.colour + "' front\n";
  }
  if (!shows_anything(chart)) {
    // gnuplot refuses to find a range in nothing.
    text += chart.logarithmic_x ? "set xrange [1:10]\n" : "";
    text += "set yrange [0.1:1]\n";
    curves = "plot 10 notitle";
  }
  text += curves + "\n";
  for (int i = 1; i <= arrow; ++i) text += "unset arrow " + std::to_string(i) + "\n";
  return text;
}

int height_of(const Chart& chart) {
  if (chart.height_px > 0) return chart.height_px;
  if (!chart.bars.empty()) return 60 + bar_px * static_cast<int>(chart.bars.size());
  return usual_height_px;
}

}  // namespace

std::string chart_commands(const std::vector<Chart>& charts,
                           const std::filesystem::path& directory) {
  std::string text;
  for (std::size_t i = 0; i < charts.size(); ++i) {
    const Chart& chart = charts[i];
    text += style(std::to_string(chart.wide ? wide_px : width_px) + "," +
                  std::to_string(height_of(chart)));
    text += "set output " + gnuplot_string((directory / (chart.name + ".svg")).string()) + "\n";
    text += plot(chart, "c" + std::to_string(i) + "_") + "unset output\n";
  }
  return text;
}

std::string stacked_chart_commands(const std::vector<Chart>& charts, const std::string& title,
                                   const std::filesystem::path& svg) {
  constexpr int title_px = 30;
  constexpr int foot_px = 40;
  constexpr int left_px = 96;
  int height = title_px + foot_px;
  for (const Chart& chart : charts) height += height_of(chart);
  constexpr int width = 900;
  std::string text = style(std::to_string(width) + "," + std::to_string(height));
  text += "set output " + gnuplot_string(svg.string()) + "\nset multiplot\nset label 1 " +
          gnuplot_text(title) + " at screen 0.012, screen " + gnuplot_number(1 - 15.0 / height) +
          " left font ',15' front\n";
  int top = title_px;
  for (std::size_t i = 0; i < charts.size(); ++i) {
    Chart chart = charts[i];
    const bool last = i + 1 == charts.size();
    if (!last) chart.x_label.clear();
    const int bottom = top + height_of(chart);
    const auto up = [&](double px) { return gnuplot_number(1 - px / height); };
    text += "set lmargin at screen " + gnuplot_number(static_cast<double>(left_px) / width) +
            "\nset rmargin at screen 0.98\nset tmargin at screen " + up(top + 26) +
            "\nset bmargin at screen " + up(bottom - 24) + "\n" +
            plot(chart, "c" + std::to_string(i) + "_") + "unset label 1\n";
    top = bottom;
  }
  return text + "unset multiplot\nunset output\n";
}

std::optional<double> logarithmic_floor(const std::vector<Curve>& curves) {
  std::vector<double> values;
  for (const Curve& curve : curves) {
    for (const Point& point : curve.points) {
      if (point.y > 0 && std::isfinite(point.y)) values.push_back(point.y);
    }
  }
  if (values.empty()) return {};
  const auto quantile = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 50);
  std::nth_element(values.begin(), quantile, values.end());
  return std::pow(10, std::floor(std::log10(*quantile) - 0.3));
}

}  // namespace tachless::report
