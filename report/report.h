#pragma once

#include <filesystem>
#include <vector>

#include "report/page_scripts.h"
#include "report/recorded_run.h"

namespace tachless::report {

/// Writes the report of these runs, labelled, to `html`: one page that needs nothing else. The file
/// appears when it is whole. Without one of the libraries the page stands still, and a warning says
/// what to install.
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot draw or the file cannot be written.
void write_report(const std::vector<RecordedRun>& runs, const std::filesystem::path& html,
                  const Libraries& libraries = read_libraries());

}  // namespace tachless::report
