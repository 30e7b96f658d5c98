#pragma once

#include <string>
#include <vector>

#include "tests/campaign/round.h"

/// What must hold of every round, each as a function: "" when it does, else what does not.
namespace tachless::campaign {

/// A 0 of plant or logger is a promise that the log has the run: in lockstep every message of every
/// tick, equal to the clean run's up to a tick for which an outsider without a key has said
/// something else; in realtime what the plant says of every tick.
std::string a_good_end_has_a_whole_log(const Evidence& evidence);

/// Also of a run that fails: in lockstep the log is whole ticks of the clean run, then the fault.
std::string the_log_is_a_beginning_of_the_clean_one(const Evidence& evidence);

/// With a key no attacker without it changes a run; nor do copies, loss, or a pause of less than
/// `give_up_s`.
std::string what_cannot_end_a_run_does_not(const Evidence& evidence);

/// A process that fails prints why, once, and has a documented exit code.
std::string every_fault_has_a_code_and_one_cause(const Evidence& evidence);

/// The log of a run that failed contains the reason.
std::string the_log_ends_with_the_fault(const Evidence& evidence);

/// A robot whose motion is not recorded stops: `give_up_s` until the logger's loss is noticed, and
/// 0.5 s to brake.
std::string nothing_moves_unrecorded(const Evidence& evidence);

/// An outsider cannot fill the disk: the log is not longer than the clean one by more than
/// `most_foreign_log_bytes`.
std::string the_log_is_bounded(const Evidence& evidence);
inline constexpr std::uintmax_t most_foreign_log_bytes = 1 << 20;

/// What a law and its signals are called in a log could be no command and no markup elsewhere.
std::string the_log_has_sound_names(const Evidence& evidence);

/// Everything ends.
std::string the_round_is_bounded(const Evidence& evidence);

/// All of them.
std::vector<std::string> violations(const Evidence& evidence);

}  // namespace tachless::campaign
