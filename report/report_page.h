#pragma once

#include <map>
#include <string>
#include <vector>

#include "report/overlay.h"
#include "report/recorded_run.h"

namespace tachless::report {

/// What gnuplot drew, by the name of its file without ending.
using Drawings = std::map<std::string, std::string>;

/// The charts as they are to be drawn.
std::vector<Chart> drawn_charts(const std::vector<ReportSection>& sections);

/// The report as one HTML page that refers to nothing outside of itself: facts and results as
/// tables, the sections with their charts, each run's scenario. A chart without a drawing is
/// replaced by its caption.
/// @param scripts what makes the page move; empty: it stands still
std::string report_page(const std::vector<RecordedRun>& runs,
                        const std::vector<ReportSection>& sections, const Drawings& drawings,
                        const Html& scripts = {});

}  // namespace tachless::report
