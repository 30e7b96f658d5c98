#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/html.h"
#include "report/recorded_run.h"
#include "report/report_sections.h"

/// The report of one or several labelled runs as one HTML page that needs no other file. It
/// contains tables, histograms as drawings, and the charts over time as data that the page's
/// scripts draw. If scripts do not run, each run's tracking figure replaces the charts over time.
namespace tachless::report {

/// The page's libraries, from Debian's libjs-dygraphs and libjs-three.
struct Libraries {
  Html scripts;            ///< one script element per file
  std::string missing;     ///< the first file that cannot be read; empty: none
  Html mesh_readers = {};  ///< readers of STL, OBJ and DAE, for pages with meshes
};

/// Reads the libraries from their place in Debian. Tests use another `root`.
Libraries read_libraries(const std::filesystem::path& root = "/usr/share/javascript");

/// Writes the report of these runs to `html`. The file appears when it is complete. If a library is
/// missing, the page has no scripts and a warning names the packages to install.
/// @throw base::Failure(bad_usage) when the file cannot be written
void write_report(const std::vector<RecordedRun>& runs, const std::filesystem::path& html,
                  const Libraries& libraries = read_libraries());

/// Returns the page of a run in progress: the charts and the robot of a report, without points.
/// page.js reads the points from `events`, in the form of live::LiveRun.
std::string live_page(const logger::RunDescription& described, const Visuals& visuals = {},
                      const Libraries& libraries = read_libraries());

/// Returns the page: facts and results as tables, the sections with their charts, each run's
/// scenario.
/// @param scripts draw the charts over time; empty: the tracking figure replaces those charts
std::string report_page(const Overlay& all, const std::vector<ReportSection>& sections,
                        const Html& scripts = {});

/// Returns the data of page.js and robot.js as JSON: charts over time as points, robots as joints.
/// No character in it ends a script element. Curves are base64 of 32-bit floats x, y, x, y, … in
/// little-endian order. Texts are HTML.
std::string page_data(const Overlay& all, const std::vector<ReportSection>& sections);

}  // namespace tachless::report
