#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "report/chart.h"
#include "report/html.h"

/// An axis of a drawn chart: its range, its ticks, and where a value lies along it.
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

  /// The range is the chart's where that is finite, else that of its curves and cells, with room;
  /// never empty, whatever the values are.
  Axis(const Chart& chart, bool ordinate, double length_px);

  /// Pixels from the left or from the top.
  [[nodiscard]] double at(double value) const;

 private:
  void join(double value);
  void widen();
  void add_decades();
  void add_ticks();
};

/// SVG: `part` in small letters, `dy` pixels below the line; `after` on the line again.
Html shifted(int dy, const std::string& part, const Html& after);

/// SVG: "·10" with that exponent; nothing for 0.
Html times_ten_to(int exponent);

}  // namespace tachless::report
