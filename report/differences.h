#pragma once

#include <vector>

#include "report/html.h"
#include "report/recorded_run.h"

namespace tachless::report {

/// What several runs do not have in common: the scenario's keys as they were written, and robots
/// with other joints. Empty for one run. `runs` are labelled.
Html differences(const std::vector<RecordedRun>& runs);

}  // namespace tachless::report
