#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "experiment/scenario.h"

namespace tachless::plant {

/// RUN_INFO of a run, as it is published and logged.
/// @param measurement, signals of the law, as the controller announces them
/// @throw diagnostics::Failure(bad_usage) when scenario and URDF are too long for one message.
std::vector<std::byte> run_info(const experiment::Scenario& scenario, std::int64_t run,
                                std::string_view measurement, std::string_view signals);

}  // namespace tachless::plant
