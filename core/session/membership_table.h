#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "messages/messages.h"

/// The reactions of a member to each event in each of its states, as one table. docs/protocol.md
/// ("States and events") shows the table. tests/core/session/membership_table_test.cpp compares the
/// two and tests every cell. The table knows neither time nor messages. core/session/membership.h
/// recognises the events and carries out the reactions.
namespace tachless::session {

/// An announcement, an event of the clock, or an event of this process itself. The announcing
/// process is alive unless the comment says otherwise. The "holder" of a role is its process in the
/// run that this member has joined.
enum class MembershipEvent {
  unproven,          ///< answers none of this process's last announcements; it may be a recording
  rival,             ///< another process of the own role
  foreign_scenario,  ///< another role with another scenario digest, alive or ended because of the
                     ///< digest
  peer,              ///< any other process of another role
  roster,            ///< a holder that names the roster: the run's plant, or (plant) a member
  other_roster,      ///< the run's plant names a roster without this process
  member_finished,   ///< a member of the joined run has finished, and this process has all its
                     ///< ticks
  member_failed,     ///< a member of the joined run announces a fault
  departure,         ///< any other process announces that it has finished or failed
  holder_gone,       ///< before the run: the adopted plant, or (plant) a member of the roster, has
                     ///< ended or is silent
  holder_silent,     ///< a watched holder that has not finished is silent for the time to give up
  wait_over,         ///< the time to wait for the others at the start has passed
  run_started,       ///< own: the first message of the run was sent or accepted
  part_finished,     ///< own: all ticks are done
  failure,           ///< own: this process ends with a fault
};
inline constexpr std::size_t num_membership_events = 15;

enum class MembershipReaction {
  ignore,         ///< nothing changes
  observe,        ///< remember the process, and name it in the next announcements
  join,           ///< observe; plant: ready when all are there; others: adopt the plant's run
  agree,          ///< observe; others: take the roster; plant: count the confirmations
  dissolve,       ///< choose another roster
  yield,          ///< fail (exit code 4), because another process of this role takes part
  contest,        ///< fail (exit code 4) unless this process has precedence
  answer,         ///< observe, and announce within 10 ms, so that the newcomer gives way soon
  refuse,         ///< fail (exit code 2) naming both scenarios
  note_finished,  ///< the member's role is done
  follow,         ///< fail with the consequence of the member's fault
  forget,         ///< no longer remember the process unless it is a holder
  start,          ///< running
  finish,         ///< finished
  fail,           ///< fault
  reject,         ///< throw std::logic_error, because the caller made a mistake
};

namespace membership_table {

struct Row {
  std::string_view event;                        ///< as in docs/protocol.md
  std::array<MembershipReaction, 5> reaction{};  ///< waiting, ready, running, finished, fault
};
using enum MembershipReaction;

// An event that cannot occur in a state is ignored. Without a run no process holds a role.
inline constexpr std::array<Row, num_membership_events> rows = {{
    {"unproven", {observe, observe, observe, observe, observe}},
    {"rival", {contest, contest, answer, ignore, ignore}},
    {"foreign scenario", {refuse, refuse, answer, ignore, ignore}},
    {"peer", {join, observe, observe, observe, observe}},
    {"roster", {join, agree, observe, observe, observe}},
    {"other roster", {join, yield, ignore, ignore, ignore}},
    {"member finished", {ignore, note_finished, note_finished, note_finished, observe}},
    {"member failed", {ignore, follow, follow, follow, ignore}},
    {"departure", {forget, forget, forget, ignore, ignore}},
    {"holder gone", {ignore, dissolve, ignore, ignore, ignore}},
    {"holder silent", {ignore, fail, fail, fail, ignore}},
    {"wait over", {fail, fail, ignore, ignore, ignore}},
    {"run started", {reject, start, ignore, ignore, ignore}},
    {"part finished", {finish, finish, finish, finish, ignore}},
    {"failure", {fail, fail, fail, fail, fail}},
}};

}  // namespace membership_table

/// Returns the reaction to an event.
/// @param state one of the five values of messages::ParticipantState
constexpr MembershipReaction reaction(MembershipEvent event, messages::ParticipantState state) {
  return membership_table::rows.at(static_cast<std::size_t>(event))
      .reaction.at(static_cast<std::size_t>(state));
}

}  // namespace tachless::session
