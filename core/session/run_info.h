#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "messages/messages.h"
#include "scenario/scenario.h"

namespace tachless::session {

/// Returns RUN_INFO of a run, as it is logged and published. It fits one datagram, because a
/// scenario has at most 60,000 bytes with its URDF.
/// @param law the controller's announcement of its law
std::vector<std::byte> run_info(const scenario::Scenario& scenario, std::int64_t run,
                                const messages::LawInfo& law);

}  // namespace tachless::session
