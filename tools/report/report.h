#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/html.h"
#include "report/recorded_run.h"
#include "report/report_sections.h"

/// The report of one run or several, labelled, as one HTML page that needs nothing else: tables,
/// histograms as drawings, and the charts over time as data, which the page's scripts draw. Where
/// scripts do not run, each run's tracking figure stands in their place.
namespace tachless::report {

/// Of Debian's libjs-dygraphs and libjs-three.
struct Libraries {
  Html scripts;            ///< one script element each
  std::string missing;     ///< the first file that cannot be read; empty: none
  Html mesh_readers = {};  ///< of STL, OBJ and DAE, for pages with meshes
};

/// Reads them where Debian installs them; `root` is for tests.
Libraries read_libraries(const std::filesystem::path& root = "/usr/share/javascript");

/// Writes the report of these runs to `html`. The file appears when it is complete. Without one of
/// the libraries the page has no scripts, and a warning names the packages to install.
/// @throw base::Failure(bad_usage) when the file cannot be written
void write_report(const std::vector<RecordedRun>& runs, const std::filesystem::path& html,
                  const Libraries& libraries = read_libraries());

/// The page of a run that goes on, for a browser: the charts and the robot of a report, without
/// points; page.js takes those from `events`, as live::LiveRun gives them.
std::string live_page(const logger::RunDescription& of, const Visuals& visuals = {},
                      const Libraries& libraries = read_libraries());

/// The page: facts and results as tables, the sections with their charts, each run's scenario.
/// @param scripts what draws the charts over time; empty: the tracking figure takes their place
std::string report_page(const Overlay& all, const std::vector<ReportSection>& sections,
                        const Html& scripts = {});

/// The data of page.js and robot.js, as JSON: charts over time as points, robots as joints. No
/// character in it ends a script element. Curves are base64 of 32-bit floats x, y, x, y, … in
/// little-endian order; texts are HTML.
std::string page_data(const Overlay& all, const std::vector<ReportSection>& sections);

}  // namespace tachless::report
