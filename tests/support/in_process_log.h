#pragma once

#include <string>
#include <vector>

#include "scenario/scenario.h"
#include "tests/support/recorded_run.h"

namespace tachless::support {

/// What a lockstep run of `scenario` logs, from the loop stepped in this process: RUN_INFO, then
/// six messages per tick in canonical order.
std::vector<logger::Recorded> in_process_log(const scenario::Scenario& scenario,
                                             std::int64_t run = 7);

/// A file of scenarios/, shortened.
scenario::Scenario shortened(const std::string& file, const std::string& duration_s,
                             std::vector<std::string> overrides = {});

}  // namespace tachless::support
