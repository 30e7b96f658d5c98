#pragma once

#include <filesystem>

#include "tests/campaign/round.h"

namespace tachless::campaign {

/// Returns the part of a plan that is possible on the real bus. No message comes before an honest
/// sender's. The network loses packets, but neither doubles nor reorders them. No transport fails.
Plan on_the_real_bus(Plan plan);

/// Plays a round with the four programs on the real bus. The attacker is the same, in a thread of
/// this process. Kills, stops and Ctrl-C are signals, sent at a number of received datagrams.
/// `directory` is emptied first; it receives the log, counters and output of the programs.
/// Precondition: the process is in a network namespace of its own.
/// @throw std::runtime_error if the network cannot be made to lose packets
Evidence play_with_programs(const Plan& plan, const std::filesystem::path& directory);

}  // namespace tachless::campaign
