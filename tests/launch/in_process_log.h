#pragma once

#include <string>
#include <vector>

#include "app/scenario.h"
#include "tests/logger/recorded_run.h"

namespace launch {

/// What a lockstep run of `scenario` logs, from the loop stepped in this process: RUN_INFO, then
/// six messages per tick in canonical order.
std::vector<logger::Recorded> in_process_log(const app::Scenario& scenario, std::int64_t run = 7);

/// A file of scenarios/, shortened.
app::Scenario shortened(const std::string& file, const std::string& duration_s,
                        std::vector<std::string> overrides = {});

}  // namespace launch
