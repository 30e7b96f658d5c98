#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/html.h"
#include "report/overlay.h"

/// What makes a report move: libraries, data and our scripts.
namespace tachless::report {

/// The libraries, of Debian's libjs-dygraphs and libjs-three.
struct Libraries {
  Html scripts;         ///< one script element each
  std::string missing;  ///< the first file that cannot be read; empty: none
};

/// Reads them where Debian installs them; `root` is for tests.
Libraries read_libraries(const std::filesystem::path& root = "/usr/share/javascript");

/// What page.js and robot.js are given, as JSON: charts over time as points, robots as joints. No
/// character in it ends a script element. Curves are base64 of 32-bit floats x, y, x, y, … in
/// little-endian order; texts are HTML.
std::string page_data(const Overlay& all, const std::vector<ReportSection>& sections);

/// The script elements of a page: the libraries, `data`, and what moves it.
Html page_scripts(const Libraries& libraries, const std::string& data);

}  // namespace tachless::report
