#pragma once

#include <vector>

#include "report/html.h"
#include "report/recorded_run.h"

/// A report's tables and warnings, with one column or row per run where there are several.
namespace tachless::report {

/// Of a run, what is not in its curves: scenario, law, gains, sampling, how it ended. Marks what
/// is not as in the first run.
Html facts_table(const std::vector<RecordedRun>& runs);

/// The head of a table with a column for each run; empty for one run.
Html run_headings(const std::vector<RecordedRun>& runs);

/// Errors, torques and decay per joint.
Html results_table(const std::vector<RecordedRun>& runs);

/// Runs that ended early, logs that are damaged; empty when there are none.
Html alarms(const std::vector<RecordedRun>& runs);

/// A sample of the line by which the run's curves are known.
Html swatch(std::size_t run);

}  // namespace tachless::report
