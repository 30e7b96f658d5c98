#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "report/chart.h"
#include "report/html.h"

/// Charts as SVG: the only writer of figures. No other program takes part, and every text is
/// escaped.
namespace tachless::report {

/// Charts below each other, in columns; a wide chart takes a row. Charts of a column share the time
/// axis at their foot.
struct Figure {
  std::string title;
  std::vector<Chart> charts;
  std::size_t columns = 1;
  double width_px = 900;
  bool one_key = false;  ///< the first chart's key, over the whole width, serves all
};

/// The SVG element, to stand in a page, with `caption` as alternative text (screen readers).
Html inline_svg(const Figure& figure, std::string_view caption);

/// Writes an SVG file, which appears when it is complete.
/// @param remedy as base::UnfinishedFile
/// @throw base::Failure(bad_usage) when it cannot be written
void write_figure(const Figure& figure, const std::filesystem::path& svg, std::string_view remedy);

}  // namespace tachless::report
