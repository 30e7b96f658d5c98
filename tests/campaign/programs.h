#pragma once

#include <filesystem>

#include "tests/campaign/round.h"

namespace tachless::campaign {

/// What of a round can be done on the real bus: no message comes before an honest sender's answer,
/// the network loses packets, but neither doubles nor reorders them, and no transport fails.
Plan on_the_real_bus(Plan plan);

/// The second backend of the campaign: plays a round with the four programs on the real bus. The
/// attacker is the same, in a thread of this process; kills, stops and Ctrl-C are signals, sent
/// when so many datagrams have been received. `directory`, emptied before, has log, counters and
/// what the programs wrote. Precondition: the process is in a network namespace of its own.
/// @throw std::runtime_error where the network cannot be made to lose packets
Evidence play_with_programs(const Plan& plan, const std::filesystem::path& directory);

}  // namespace tachless::campaign
