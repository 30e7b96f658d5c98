#pragma once

#include <string>
#include <vector>

#include "scenario/scenario.h"
#include "tests/support/recorded_run.h"

namespace tachless::support {

/// Returns the log of a lockstep run of `scenario`, stepped in this process: RUN_INFO, then six
/// messages per tick in canonical order.
std::vector<logger::Recorded> in_process_log(const scenario::Scenario& scenario,
                                             std::int64_t run = 7);

/// Returns a shortened file of scenarios/.
scenario::Scenario shortened(const std::string& file, const std::string& duration_s,
                             std::vector<std::string> overrides = {});

}  // namespace tachless::support
