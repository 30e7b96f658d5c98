#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "report/chart.h"
#include "report/html.h"

/// An axis of a chart: its range, its ticks and the position of a value along it.
namespace tachless::report {

struct Tick {
  double value;
  Html text;  ///< SVG
};

struct Axis {
  bool vertical, logarithmic;
  double length_px;
  double low = INFINITY, high = -INFINITY;
  std::vector<Tick> ticks = {};
  int exponent = 0;  ///< the ticks' numbers are in units of 10^exponent

  /// Takes the range from the chart if it is finite. Otherwise takes it from the chart's curves and
  /// cells, with some space around them. The range is never empty.
  Axis(const Chart& chart, bool ordinate, double length_px);

  /// Returns the position in pixels from the left or from the top.
  [[nodiscard]] double at(double value) const;

 private:
  void join(double value);
  void widen();
  void add_decades();
  void add_ticks();
};

/// Returns SVG with `part` in small letters, `dy` pixels below the line, and `after` on the line.
Html shifted(int dy, const std::string& part, const Html& after);

/// Returns SVG of "·10" with that exponent; empty for exponent 0.
Html times_ten_to(int exponent);

}  // namespace tachless::report
