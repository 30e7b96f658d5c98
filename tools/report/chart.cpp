#include "report/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/text.h"

namespace tachless::report {

Label words(std::string text, std::string unit) {
  return {"", "", std::move(text), std::move(unit)};
}

Label of_joint(std::string symbol, std::size_t joint, std::string_view name, std::string unit) {
  constexpr std::size_t longest = 18;
  const bool cut = name.size() > longest;  // the end of a name distinguishes joints
  if (cut) name.remove_prefix(name.size() - longest + 1);
  while (cut && base::utf8_length(name) == 0) name.remove_prefix(1);
  return {std::move(symbol), std::to_string(joint + 1), fmt::format("{}{}", cut ? "…" : "", name),
          std::move(unit)};
}

Html html_of(const Label& label) {
  Html result;
  if (!label.symbol.empty()) {
    const Html bar(label.magnitude ? "|" : "");
    result = html("{}<i>{}</i>{}{}", bar, label.symbol,
                  label.index.empty() ? Html() : html("<sub>{}</sub>", label.index), bar);
  }
  for (const std::string& part : {label.text, label.unit.empty() ? "" : "[" + label.unit + "]"}) {
    if (!part.empty()) result += html("{}{}", result.empty() ? "" : " ", part);
  }
  return result;
}

std::string colour_of(std::size_t curve) { return palette[curve % palette.size()]; }

std::vector<int> dash_of(std::size_t curve) {
  static const std::array<std::vector<int>, 4> dashes = {{{}, {8, 3}, {3, 2}, {8, 3, 2, 3}}};
  return dashes[curve / palette.size() % dashes.size()];
}

std::string ColourScale::colour(double value) const {
  using Colour = std::array<double, 3>;
  constexpr Colour blue = {0x21, 0x66, 0xAC}, white = {0xF7, 0xF7, 0xF7}, red = {0xB2, 0x18, 0x2B};
  const double share =
      logarithmic ? std::log(value / low) / std::log(high / low) : (value - low) / (high - low);
  // 0.5 for a range of one value.
  const double at = std::isfinite(share) ? std::clamp(share, 0.0, 1.0) : 0.5;
  const Colour& from = at < 0.5 ? blue : white;
  const Colour& to = at < 0.5 ? white : red;
  const double part = at < 0.5 ? 2 * at : 2 * at - 1;
  std::string text = "#";
  for (std::size_t i = 0; i < 3; ++i) {
    text +=
        fmt::format("{:02X}", static_cast<int>(std::lround(from[i] + part * (to[i] - from[i]))));
  }
  return text;
}

bool shown(const Chart& chart, const study::Point& point) {
  constexpr double largest = 1e100;  // larger pixel differences overflow
  return std::abs(point.x) < largest && std::abs(point.y) < largest &&
         !(chart.logarithmic_x && point.x < least_shown) &&
         !(chart.logarithmic_y && point.y < least_shown);
}

bool has_something(const Chart& chart) {
  return !chart.cells.empty() || std::ranges::any_of(chart.curves, [&](const Curve& curve) {
    return std::ranges::any_of(curve.points,
                               [&](const study::Point& point) { return shown(chart, point); });
  });
}

void cut_kick(Chart& chart, const std::string& unit) {
  constexpr double kick = 0.05;  // largest share of the points at either end of the values
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
    for (const study::Point& point : curve.points) {
      if (!std::isnan(point.y)) values.push_back(point.y);
    }
    if (values.empty()) values = {0};
    std::ranges::sort(values);
    const auto skip = static_cast<std::size_t>(kick * static_cast<double>(values.size()));
    whole.join(values.front(), values.back());
    usual.join(values[skip], values[values.size() - 1 - skip]);
  }
  if (!(usual.span() > least_shown) || whole.span() <= 4 * usual.span()) return;
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
      if (shown(chart, point)) values.push_back(point.y);
    }
  }
  if (values.empty()) return;
  const auto quantile = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 50);
  std::nth_element(values.begin(), quantile, values.end());
  chart.y_range = {{std::pow(10, std::floor(std::log10(*quantile) - 0.3)), INFINITY}};
}

}  // namespace tachless::report
