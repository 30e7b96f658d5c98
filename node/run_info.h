#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "experiment/scenario.h"
#include "loop/messages.h"

namespace tachless::node {

/// RUN_INFO of a run, as it is logged and published. It fits one datagram: a scenario has at most
/// 60,000 bytes with its URDF.
/// @param law as the controller announces it
std::vector<std::byte> run_info(const experiment::Scenario& scenario, std::int64_t run,
                                const loop::LawInfo& law);

}  // namespace tachless::node
