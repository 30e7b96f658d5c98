#include "report/axis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

namespace tachless::report {
namespace {

std::string minus(std::string number) {
  if (number.starts_with('-')) number.replace(0, 1, "−");
  return number;
}

Html ten_to(int exponent) { return Html("10") + shifted(-5, minus(std::to_string(exponent)), {}); }

}  // namespace

Html shifted(int dy, const std::string& part, const Html& after) {
  const Html small = html("<tspan dy=\"{}\" font-size=\"10\">{}</tspan>", dy, part);
  return after.empty() ? small : small + html("<tspan dy=\"{}\">{}</tspan>", -dy, after);
}

Html times_ten_to(int exponent) { return exponent == 0 ? Html() : Html("·") + ten_to(exponent); }

Axis::Axis(const Chart& chart, bool ordinate, double length)
    : vertical(ordinate),
      logarithmic(ordinate ? chart.logarithmic_y : chart.logarithmic_x),
      length_px(length) {
  for (const Curve& curve : chart.curves) {
    for (const study::Point& point : curve.points) {
      if (shown(chart, point)) join(vertical ? point.y : point.x);
    }
  }
  for (const Cell& cell : chart.cells) {
    join(vertical ? cell.bottom : cell.left);
    join(vertical ? cell.top : cell.right);
  }
  widen();
  const auto& given = vertical ? chart.y_range : chart.x_range;
  if (given && std::isfinite(given->first)) low = given->first;
  if (given && std::isfinite(given->second)) high = given->second;
  if (logarithmic) low = std::max(low, least_shown);
  if (!(low < high)) high = logarithmic ? 10 * low : low + std::max(1.0, std::abs(low));
  if (logarithmic) add_decades();
  if (ticks.size() < 2) add_ticks();
}

double Axis::at(double value) const {
  const double share = logarithmic
                           ? std::log(std::max(value, least_shown) / low) / std::log(high / low)
                           : (value - low) / (high - low);
  // A point far outside is clipped in any case.
  return std::clamp(vertical ? 1 - share : share, -10.0, 10.0) * length_px;
}

void Axis::join(double value) {
  low = std::min(low, value);
  high = std::max(high, value);
}

/// Adds room around the range of the values. Gives the range a width if all values are equal.
void Axis::widen() {
  constexpr double narrowest = 2e-3;  // share of the largest value: ticks of four digits
  if (!(low <= high)) {
    low = logarithmic ? 0.1 : 0;
    high = 1;
  }
  if (logarithmic) {
    const double room = vertical ? std::max(1.2, std::pow(high / low, 0.04)) : 1;
    low /= room;
    high *= room;
    return;
  }
  const double largest = std::max(std::abs(low), std::abs(high));
  if (largest < least_shown) {
    low = -1;
    high = 1;
  } else if (high - low < narrowest * largest) {
    const double centre = (low + high) / 2;
    low = centre - narrowest / 2 * largest;
    high = centre + narrowest / 2 * largest;
  }
  const double room = vertical ? 0.05 * (high - low) : 0;
  low -= room;
  high += room;
}

void Axis::add_decades() {
  const int first = static_cast<int>(std::ceil(std::log10(low) - 1e-9));
  const int last = static_cast<int>(std::floor(std::log10(high) + 1e-9));
  constexpr double apart_px = 34;
  const int step =
      std::max(1, static_cast<int>(std::ceil((last - first + 1) * apart_px / length_px)));
  for (int k = first; k <= last; ++k) {
    if (k % step == 0) ticks.push_back({std::pow(10, k), ten_to(k)});
  }
}

void Axis::add_ticks() {
  ticks.clear();
  const double most = std::clamp(length_px / (vertical ? 40 : 75), 2.0, 10.0);
  const double least = (high - low) / most;
  double step = std::pow(10, std::floor(std::log10(least)));
  for (const double factor : {2.0, 2.5, 2.0}) {  // 1, 2, 5, 10
    if (step < least * (1 - 1e-9)) step *= factor;
  }
  const double largest = std::max(std::abs(low), std::abs(high));
  const int order = static_cast<int>(std::floor(std::log10(largest)));
  if (order > 4 || order < -3) exponent = order;
  const double unit = std::pow(10, exponent);
  const int decimals = std::max(0, static_cast<int>(std::ceil(-std::log10(step / unit) - 1e-6)));
  const auto last = static_cast<std::int64_t>(std::floor(high / step + 1e-6));
  for (auto k = static_cast<std::int64_t>(std::ceil(low / step - 1e-6)); k <= last; ++k) {
    const double value = static_cast<double>(k) * step;
    ticks.push_back({value, Html(minus(fmt::format("{:.{}f}", value / unit, decimals)))});
  }
}

}  // namespace tachless::report
