#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "experiment/scenario.h"
#include "loop/messages.h"

namespace tachless::plant {

/// RUN_INFO of a run, as it is published and logged.
/// @param law as the controller announces it
/// @throw diagnostics::Failure(bad_usage) when scenario and URDF are too long for one message.
std::vector<std::byte> run_info(const experiment::Scenario& scenario, std::int64_t run,
                                const loop::LawInfo& law);

}  // namespace tachless::plant
