#pragma once

#include <string>
#include <vector>

#include "tests/campaign/round.h"

/// What must hold of every round, each as a function: "" when it does, else what does not.
namespace tachless::campaign {

/// A 0 of plant or logger is a promise that the log has the run: in lockstep every message of every
/// tick, equal to the clean run's up to a tick for which a stranger without a key has said
/// something else; in realtime what the plant says of every tick.
std::string nobody_ends_well_without_a_whole_log(const Evidence& evidence);

/// Also of a run that fails: in lockstep the log is whole ticks of the clean run, then the fault.
std::string the_log_is_a_beginning_of_the_clean_one(const Evidence& evidence);

/// With a key nobody without it does anything to a run; nor do copies, loss, or standing still for
/// less than `give_up_s`.
std::string what_cannot_end_a_run_does_not(const Evidence& evidence);

/// Whoever fails says why, with a code that people and scripts know, once.
std::string every_fault_has_a_code_and_one_cause(const Evidence& evidence);

/// The log of a run that failed tells why: its reader need not ask anybody else.
std::string the_log_ends_with_the_fault(const Evidence& evidence);

/// A robot that nobody watches stops: `give_up_s` until the logger's loss is noticed, and 0.5 s to
/// brake.
std::string nothing_moves_unrecorded(const Evidence& evidence);

/// Everything ends.
std::string the_round_is_bounded(const Evidence& evidence);

/// All of them.
std::vector<std::string> violations(const Evidence& evidence);

}  // namespace tachless::campaign
