#pragma once

#include "report/overlay.h"

/// What a report says besides its signals: how long answers took, and what went wrong when.
namespace tachless::report {

/// Histograms of times, from the runs' summary.json.
ReportSection timing_section(const Overlay& all);

/// Saturation, missed commands, missing records and faults, per run.
ReportSection events_section(const Overlay& all);

}  // namespace tachless::report
