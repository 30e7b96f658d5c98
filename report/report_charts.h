#pragma once

#include <vector>

#include "report/overlay.h"
#include "report/recorded_run.h"

namespace tachless::report {

/// The sections of a report: tracking, error, torque, controller signals, Lyapunov function,
/// timing, events. Several runs are overlaid; `runs` are labelled.
std::vector<ReportSection> report_sections(const std::vector<RecordedRun>& runs,
                                           Detail detail = Detail::paper);

}  // namespace tachless::report
