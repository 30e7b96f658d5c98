#pragma once

#include <string>
#include <vector>

#include "tests/campaign/round.h"

/// The invariants of every round. Each function returns "" if its invariant holds, else a
/// description of the violation.
namespace tachless::campaign {

/// Checks that exit code 0 of plant or logger implies a complete log. In lockstep the log has every
/// message of every tick. These equal the clean run's up to a tick for which an outsider without a
/// key has sent a false message. In realtime the log has all the plant's messages of every tick.
std::string a_good_end_has_a_whole_log(const Evidence& evidence);

/// Checks, also for a failed run in lockstep, that the log is whole ticks of the clean run and then
/// the fault.
std::string the_log_is_a_beginning_of_the_clean_one(const Evidence& evidence);

/// Checks that no attacker without the key changes a run with a key. Copies, losses and a pause
/// shorter than `give_up_s` do not change it either.
std::string what_cannot_end_a_run_does_not(const Evidence& evidence);

/// Checks that a failing process prints the reason once and has a documented exit code.
std::string every_fault_has_a_code_and_one_cause(const Evidence& evidence);

/// Checks that the log of a failed run contains the reason.
std::string the_log_ends_with_the_fault(const Evidence& evidence);

/// Checks that a robot stops when its motion is not recorded: `give_up_s` until the logger's loss
/// is noticed, and 0.5 s to brake.
std::string nothing_moves_unrecorded(const Evidence& evidence);

/// Checks that an outsider cannot fill the disk: the log exceeds the clean one by at most
/// `most_foreign_log_bytes`.
std::string the_log_is_bounded(const Evidence& evidence);
inline constexpr std::uintmax_t most_foreign_log_bytes = 1 << 20;

/// Checks that the names of a law and its signals in a log are no command and no markup for other
/// programs.
std::string the_log_has_sound_names(const Evidence& evidence);

/// Checks that all processes end.
std::string the_round_is_bounded(const Evidence& evidence);

/// Checks all invariants.
std::vector<std::string> violations(const Evidence& evidence);

}  // namespace tachless::campaign
