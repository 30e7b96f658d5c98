#pragma once

#include <vector>

#include "report/html.h"
#include "report/recorded_run.h"

/// A report's tables and warnings, with one column or row per run where there are several. `runs`
/// are labelled.
namespace tachless::report {

/// Of a run, what is not in its curves: scenario, law, gains, sampling, how it ended. Marks what
/// is not as in the first run.
Html facts_table(const std::vector<RecordedRun>& runs);

/// What several runs do not have in common: the scenario's keys as they were written, and robots
/// with other joints. Empty for one run.
Html differences(const std::vector<RecordedRun>& runs);

/// Errors, torques and decay per joint.
Html results_table(const std::vector<RecordedRun>& runs);

/// Runs that ended early, logs that are damaged; empty when there are none.
Html alarms(const std::vector<RecordedRun>& runs);

/// A sample of the line by which the run's curves are known.
Html swatch(const RecordedRun& run);

}  // namespace tachless::report
