#pragma once

#include <filesystem>

#include "tests/campaign/round.h"

namespace tachless::soak {

/// What of a round of the campaign is done on the real bus: there nothing comes before an honest
/// sender's answer, and the network loses packets, but neither doubles nor reorders them.
campaign::Plan on_the_real_bus(campaign::Plan plan);

/// Plays a round of the fault campaign with the four programs on the real bus: the same hostile
/// member, in a thread of this process, and kills, stops and Ctrl-C by signal when it has heard so
/// many datagrams. `directory`, emptied before, has log, counters and what the programs wrote.
/// Judges nothing. Precondition: the process is in a network namespace of its own.
/// @throw diagnostics::Failure as PacketLoss
campaign::Evidence attack(const campaign::Plan& plan, const std::filesystem::path& directory);

}  // namespace tachless::soak
