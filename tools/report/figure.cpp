#include "report/figure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/file_text.h"
#include "report/axis.h"

namespace tachless::report {
namespace {

constexpr double title_px = 34, heading_px = 22, key_row_px = 20, above_px = 8;
constexpr double tick_px = 22, label_px = 24, below_px = 14;
constexpr double left_px = 86, right_px = 18, scale_px = 92;
constexpr const char *small = " font-size=\"12\"", *bold = " font-weight=\"600\"";
constexpr const char *grid_colour = "#e2e2e2", *axis_colour = "#444444";

Html svg_of(const Label& label) {
  Html rest;
  for (const std::string& part : {label.text, label.unit.empty() ? "" : "[" + label.unit + "]"}) {
    if (!part.empty()) rest += html("{}{}", rest.empty() ? "" : " ", part);
  }
  if (label.symbol.empty()) return rest;
  // A space at the beginning of an element would be dropped.
  if (!rest.empty()) rest = html("<tspan dx=\"4\">{}</tspan>", rest);
  const Html bar(label.magnitude ? "|" : "");
  const Html symbol = html("{}<tspan font-style=\"italic\">{}</tspan>", bar, label.symbol);
  if (label.index.empty()) return symbol + bar + rest;
  return symbol + shifted(4, label.index, bar + rest);
}

/// Returns the approximate width of a label.
double text_px(const Label& label) {
  const std::string letters = label.symbol + label.index + label.text + label.unit;
  const auto count = std::ranges::count_if(letters, [](char c) { return (c & 0xc0) != 0x80; });
  return 7.0 * static_cast<double>(count);  // UTF-8
}

/// Formats a number of pixels with few digits.
std::string px(double value) { return fmt::format("{:.6g}", value); }

Html text(double x, double y, const char* anchor, const Html& content, const char* more = "") {
  if (content.empty()) return {};
  return html("<text x=\"{}\" y=\"{}\" text-anchor=\"{}\"{}>{}</text>\n", px(x), px(y), anchor,
              Html::from_markup(more), content);
}

Html line(double x1, double y1, double x2, double y2, std::string_view colour, double width = 1,
          const Html& dash = {}) {
  return html(
      "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{}\" stroke-width=\"{}\"{}/>\n",
      px(x1), px(y1), px(x2), px(y2), colour, width, dash);
}

Html rectangle(double x, double y, double width, double height, std::string_view colour) {
  return html("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"/>\n", px(x), px(y),
              px(width), px(height), colour);
}

Html dashes(const Curve& curve) {
  if (curve.dash.empty()) return {};
  return html(" stroke-dasharray=\"{}\"", fmt::format("{}", fmt::join(curve.dash, ",")));
}

Html marker(Marker kind, double x, double y, const std::string& colour) {
  switch (kind) {
    case Marker::none:
      return {};
    case Marker::dot:
      return html("<circle cx=\"{}\" cy=\"{}\" r=\"2.5\" fill=\"{}\"/>\n", px(x), px(y), colour);
    case Marker::ring:
      return html(
          "<circle cx=\"{}\" cy=\"{}\" r=\"4\" fill=\"none\" stroke=\"{}\" "
          "stroke-width=\"1.4\"/>\n",
          px(x), px(y), colour);
    case Marker::cross:
      return html("<path d=\"M{} {}l7 7m0 -7l-7 7\" stroke=\"{}\" stroke-width=\"1.6\"/>\n",
                  px(x - 3.5), px(y - 3.5), colour);
    case Marker::square:
      return rectangle(x - 5.5, y - 5.5, 11, 11, colour);
  }
  return {};
}

/// Draws the points joined by straight lines, with a gap at a point that is not shown.
Html drawn(const Chart& chart, const Curve& curve, const Axis& x, const Axis& y) {
  std::string path, previous;
  Html markers;
  bool pen_down = false;
  for (const study::Point& point : curve.points) {
    if (!shown(chart, point)) {
      pen_down = false;
      continue;
    }
    const double at_x = x.at(point.x), at_y = y.at(point.y);
    markers += marker(curve.marker, at_x, at_y, curve.colour);
    const std::string place = fmt::format("{:.1f} {:.1f}", at_x, at_y);
    if (pen_down && place == previous) continue;
    path += pen_down ? "L" + place : "M" + place + "l0 0";  // a single point becomes a dot
    previous = place;
    pen_down = true;
  }
  if (curve.width == 0 || path.empty()) return markers;
  return html(
             "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" "
             "stroke-linejoin=\"round\" stroke-linecap=\"{}\"{}/>\n",
             path, curve.colour, curve.width, curve.dash.empty() ? "round" : "butt",
             dashes(curve)) +
         markers;
}

Html drawn(const Cell& cell, const Axis& x, const Axis& y) {
  const double left = x.at(cell.left), top = y.at(cell.top);
  if (cell.left == cell.right) return marker(Marker::dot, left, top, cell.colour);
  constexpr double overlap = 0.3;  // the overlap hides seams
  return rectangle(left, top, x.at(cell.right) - left + overlap, y.at(cell.bottom) - top + overlap,
                   cell.colour);
}

/// Draws the names of the curves in rows of that width.
/// @return number of rows
int draw_key(const Chart& chart, double left, double top, double width, Html& svg) {
  constexpr double sample_px = 26, gap_px = 16;
  double x = 0;
  int row = 0;
  for (const Curve& curve : chart.curves) {
    if (curve.label.empty()) continue;
    const double needed = sample_px + 6 + text_px(curve.label) + gap_px;
    if (x > 0 && x + needed > width) {
      x = 0;
      ++row;
    }
    const double at = left + x, y = top + row * key_row_px + 10;
    if (curve.width > 0) {
      svg +=
          line(at, y, at + sample_px, y, curve.colour, std::max(1.4, curve.width), dashes(curve));
    }
    svg += marker(curve.marker, at + sample_px / 2, y, curve.colour);
    svg += text(at + sample_px + 6, y + 4.5, "start", svg_of(curve.label));
    x += needed;
  }
  return x > 0 ? row + 1 : 0;
}

void draw_scale(const ColourScale& scale, double left, double top, double height, Html& svg) {
  constexpr int pieces = 64;
  Chart chart;  // the scale is the ordinate of this chart
  chart.logarithmic_y = scale.logarithmic;
  chart.y_range = {{scale.low, scale.high}};
  const Axis axis(chart, true, height);
  for (int k = 0; k < pieces; ++k) {
    const double share = (k + 0.5) / pieces;
    const double value = axis.logarithmic ? axis.low * std::pow(axis.high / axis.low, share)
                                          : axis.low + share * (axis.high - axis.low);
    svg += rectangle(left, top + height * (pieces - 1 - k) / pieces, 12, height / pieces + 0.5,
                     scale.colour(value));
  }
  for (const Tick& tick : axis.ticks) {
    svg += text(left + 17, top + axis.at(tick.value) + 4, "start", tick.text, small);
  }
  svg +=
      text(left + 12, top - 8, "middle", svg_of(scale.label) + times_ten_to(axis.exponent), small);
}

/// The rectangle of a chart's axes in a figure.
struct Box {
  double left, top, width, height;
  [[nodiscard]] double right() const { return left + width; }
  [[nodiscard]] double bottom() const { return top + height; }
};

void draw_axes(const Chart& chart, const Box& box, const Axis& x, const Axis& y, bool numbers,
               Html& svg) {
  for (const Tick& tick : x.ticks) {
    const double at = box.left + x.at(tick.value);
    svg += line(at, box.top, at, box.bottom() + 4, grid_colour);
    if (numbers) svg += text(at, box.bottom() + 18, "middle", tick.text, small);
  }
  for (const Tick& tick : y.ticks) {
    const double at = box.top + y.at(tick.value);
    svg += line(box.left - 4, at, box.right(), at, grid_colour);
    svg += text(box.left - 8, at + 4, "end", tick.text, small);
  }
  svg += text(box.left - 8, box.top - 8, "end", times_ten_to(y.exponent), small);
  if (numbers) {
    svg += text(box.left + box.width / 2, box.bottom() + tick_px + 14, "middle",
                svg_of(chart.x_label) + times_ten_to(x.exponent));
  }
  svg += html("<text transform=\"translate({} {}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
              px(box.left - 58), px(box.top + box.height / 2), svg_of(chart.y_label));
}

void draw_chart(const Chart& chart, const Box& box, bool numbers, Html& svg) {
  const Axis x(chart, false, box.width), y(chart, true, box.height);
  draw_axes(chart, box, x, y, numbers, svg);
  // An inner svg element clips its content.
  svg += html("<svg x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" overflow=\"hidden\">\n",
              px(box.left), px(box.top), px(box.width), px(box.height));
  for (const Cell& cell : chart.cells) svg += drawn(cell, x, y);
  for (const Curve& curve : chart.curves) svg += drawn(chart, curve, x, y);
  svg += Html::from_markup("</svg>\n");
  svg += line(box.left, box.bottom(), box.right(), box.bottom(), axis_colour);
  svg += line(box.left, box.top, box.left, box.bottom(), axis_colour);
  if (!chart.note.empty()) {
    svg += text(box.right() - 6, box.top + 15, "end", Html(chart.note), small);
  }
  if (chart.scale) draw_scale(*chart.scale, box.right() + 16, box.top, box.height, svg);
}

/// Charts side by side.
struct Row {
  std::vector<const Chart*> charts;
  std::size_t columns = 1;
  bool numbers = true;  ///< numbers below the time axis
};

std::vector<Row> rows_of(const Figure& figure) {
  std::vector<Row> rows;
  for (const Chart& chart : figure.charts) {
    const bool joins = !rows.empty() && !chart.wide && !rows.back().charts.front()->wide &&
                       rows.back().charts.size() < figure.columns;
    if (!joins) rows.push_back({{}, chart.wide ? 1 : figure.columns});
    rows.back().charts.push_back(&chart);
  }
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    const Row& next = rows[i + 1];
    rows[i].numbers = !rows[i].charts.front()->over_time ||
                      rows[i].charts.size() > next.charts.size() || rows[i].columns != next.columns;
  }
  return rows;
}

/// Draws the charts of a row from `y` on.
/// @return y of the row's end
double draw_row(const Figure& figure, const Row& row, double y, Html& svg) {
  const double cell_px = figure.width_px / static_cast<double>(row.columns);
  const auto box_of = [&](const Chart& chart, double left) {
    const double width = cell_px - left_px - right_px - (chart.scale ? scale_px : 0);
    return Box{left + left_px, 0, width, static_cast<double>(chart.height_px)};
  };
  int key_rows = 0;
  double height = 0;
  bool headed = false;
  Html measured;
  for (const Chart* chart : row.charts) {
    if (!figure.one_key) {
      key_rows = std::max(key_rows, draw_key(*chart, 0, 0, box_of(*chart, 0).width, measured));
    }
    height = std::max<double>(height, chart->height_px);
    headed = headed || !chart->heading.empty();
  }
  const double key_top = y + above_px + (headed ? heading_px : 0);
  const double top = key_top + key_row_px * key_rows + (key_rows > 0 ? 4 : 0);
  double left = 0;
  for (const Chart* chart : row.charts) {
    Box box = box_of(*chart, left);
    box.top = top;
    box.height = height;
    svg += text(box.left + box.width / 2, y + above_px + 10, "middle", Html(chart->heading), bold);
    if (!figure.one_key) draw_key(*chart, box.left, key_top, box.width, svg);
    draw_chart(*chart, box, row.numbers, svg);
    left += cell_px;
  }
  return top + height + (row.numbers ? tick_px + label_px : 0) + below_px;
}

}  // namespace

Html inline_svg(const Figure& figure, std::string_view caption) {
  Html svg;
  double y = 6;
  if (!figure.title.empty()) {
    svg += text(14, y + 17, "start", Html(figure.title), " font-size=\"15\" font-weight=\"600\"");
    y += title_px;
  }
  if (figure.one_key && !figure.charts.empty()) {
    y += key_row_px * draw_key(figure.charts.front(), 24, y, figure.width_px - 40, svg);
  }
  for (const Row& row : rows_of(figure)) y = draw_row(figure, row, y, svg);
  return html(
      "<svg role=\"img\" aria-label=\"{}\" viewBox=\"0 0 {} {}\" "
      "font-family=\"Helvetica,Arial,sans-serif\" font-size=\"13\" fill=\"#222222\">\n"
      "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{}</svg>\n",
      caption, px(figure.width_px), px(y), svg);
}

void write_figure(const Figure& figure, const std::filesystem::path& svg, std::string_view remedy) {
  base::UnfinishedFile file(svg, remedy);
  std::string text = inline_svg(figure, figure.title).markup();
  text.insert(4, " xmlns=\"http://www.w3.org/2000/svg\"");
  file.write("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + text);
}

}  // namespace tachless::report
