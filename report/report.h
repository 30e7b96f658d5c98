#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/html.h"
#include "report/recorded_run.h"
#include "report/report_sections.h"

/// The report of one run or several, labelled, as one HTML page that needs nothing else: each chart
/// as a still that gnuplot draws, and those over time as data, which the page's scripts make move.
namespace tachless::report {

/// Of Debian's libjs-dygraphs and libjs-three.
struct Libraries {
  Html scripts;         ///< one script element each
  std::string missing;  ///< the first file that cannot be read; empty: none
};

/// Reads them where Debian installs them; `root` is for tests.
Libraries read_libraries(const std::filesystem::path& root = "/usr/share/javascript");

/// Writes the report of these runs to `html`. The file appears when it is whole. Without one of the
/// libraries the page stands still, and a warning says what to install.
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot draw or the file cannot be written.
void write_report(const std::vector<RecordedRun>& runs, const std::filesystem::path& html,
                  const Libraries& libraries = read_libraries());

/// The charts as they are to be drawn, of all sections.
std::vector<Chart> drawn_charts(const std::vector<ReportSection>& sections);

/// The page: facts and results as tables, the sections with their charts, each run's scenario.
/// @param drawings what gnuplot drew of the charts, in their order; a chart without one is replaced
/// by its caption
/// @param scripts what makes the page move; empty: it stands still
std::string report_page(const std::vector<RecordedRun>& runs,
                        const std::vector<ReportSection>& sections,
                        const std::vector<std::string>& drawings, const Html& scripts = {});

/// What page.js and robot.js are given, as JSON: charts over time as points, robots as joints. No
/// character in it ends a script element. Curves are base64 of 32-bit floats x, y, x, y, … in
/// little-endian order; texts are HTML.
std::string page_data(const Overlay& all, const std::vector<ReportSection>& sections);

}  // namespace tachless::report
