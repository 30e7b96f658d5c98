#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "report/chart.h"
#include "report/html.h"

/// Charts as SVG. No other program is needed, and every text is escaped.
namespace tachless::report {

/// Charts in rows of `columns` charts; a wide chart takes a row of its own. The charts of a column
/// share the time axis below the last chart.
struct Figure {
  std::string title;
  std::vector<Chart> charts;
  std::size_t columns = 1;
  double width_px = 900;
  /// The legend of the first chart stands for all charts, over the whole width.
  bool one_key = false;
};

/// Returns an SVG element for a page, with `caption` as alternative text (screen readers).
Html inline_svg(const Figure& figure, std::string_view caption);

/// Writes an SVG file. The file appears when it is complete.
/// @param remedy as for base::UnfinishedFile
/// @throw base::Failure(bad_usage) when it cannot be written
void write_figure(const Figure& figure, const std::filesystem::path& svg, std::string_view remedy);

}  // namespace tachless::report
