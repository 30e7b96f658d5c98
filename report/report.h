#pragma once

#include <filesystem>
#include <vector>

#include "report/recorded_run.h"

namespace tachless::report {

/// Writes the report of these runs, labelled, to `html`: one page that needs nothing else. The file
/// appears when it is whole.
/// @throw diagnostics::Failure(bad_usage) when gnuplot cannot draw or the file cannot be written.
void write_report(const std::vector<RecordedRun>& runs, const std::filesystem::path& html);

}  // namespace tachless::report
