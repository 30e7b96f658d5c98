#include "session/membership.h"

#include <fmt/core.h>

#include <stdexcept>
#include <utility>

#include "base/clock.h"
#include "base/text.h"

namespace tachless::session {
namespace {

using base::ExitCode;
using base::Failure;
using messages::ParticipantState;
using messages::Role;
using Event = MembershipEvent;
using Reaction = MembershipReaction;

constexpr std::array all_roles = {Role::plant, Role::reference, Role::controller, Role::logger};
// Replies to newcomers are limited to one per this time.
constexpr std::chrono::milliseconds shortest_reply_period{10};
constexpr std::string_view beside_it =
    "to run beside it, add --isolate, or use another bus (--lcm-url)";

bool is_over(ParticipantState state) {
  return state == ParticipantState::finished || state == ParticipantState::fault;
}

/// Returns whether the process has ended because of its options, its scenario or its log.
bool is_bad_usage(const messages::Participant& peer) {
  return peer.state == ParticipantState::fault &&
         peer.fault_code == static_cast<int>(ExitCode::bad_usage);
}

bool names_roster(const messages::Participant& who) {
  const std::int64_t plant = who.roster[index(Role::plant)];
  return plant != 0 && (who.role != Role::plant || plant == who.instance);
}

Failure consequence_of(const Peers::Peer& failed) {
  ExitCode code = ExitCode::peer_lost;
  for (const ExitCode passed_on : {ExitCode::protocol_violated, ExitCode::protective_stop}) {
    if (failed.participant.fault_code == static_cast<int>(passed_on)) code = passed_on;
  }
  const std::string& fault = failed.participant.fault;
  return {code, "ended because of {}: {}", describe(failed),
          fault.empty() ? "no reason given" : fault};
}

Failure other_scenario(const Peers::Peer& other, const messages::Participant& own) {
  const auto scenario_of = [](const messages::Participant& who) {
    return fmt::format(
        "{} (digest {:016x})",
        who.scenario.empty() ? "another scenario" : fmt::format("scenario '{}'", who.scenario),
        static_cast<std::uint64_t>(who.scenario_digest));
  };
  return base::bad_usage(
      "{} runs {}, this {} runs {}; give all four programs the same file and the same --set",
      describe(other), scenario_of(other.participant), messages::name(own.role), scenario_of(own));
}

}  // namespace

Membership::Membership(const Self& self, Time now)
    : self_(self),
      start_(now),
      announce_at_(now),
      announced_(now - period),
      polled_(now),
      run_(self.run),
      peers_(self.who.role, self.who.instance, self.counters_required),
      announcement_{{}, self.who} {
  if ((own_role() == Role::plant) != (self.run > 0)) {
    throw std::logic_error("the plant, and no other role, chooses the run");
  }
}

bool Membership::in_own_run(const messages::Stamp& stamp, const messages::Participant& peer) const {
  const std::int64_t known = holder(peer.role);
  const bool in_run = own_role() == Role::plant ? joined_ : state_ != ParticipantState::waiting;
  return in_run && stamp.run == run_ && (known == 0 || known == peer.instance);
}

Event Membership::event_of(const messages::Stamp& stamp, const messages::Participant& peer) const {
  const bool same_role = peer.role == own_role();
  const bool foreign = !same_role && peer.scenario_digest != self_.who.scenario_digest;
  const std::int64_t known = holder(peer.role);
  if (is_over(peer.state)) {
    if (!same_role && in_own_run(stamp, peer)) {
      if (peer.state == ParticipantState::fault) return Event::member_failed;
      // Without all ticks here the run is not over, and another process may have announced its end.
      return complete_ ? Event::member_finished : Event::peer;
    }
    if (!joined_ && known == peer.instance) return Event::holder_gone;
    return is_bad_usage(peer) && foreign ? Event::foreign_scenario : Event::departure;
  }
  if (same_role) return Event::rival;
  if (foreign) return Event::foreign_scenario;
  return known == 0 || known == peer.instance ? event_of_roster(peer) : Event::peer;
}

Event Membership::event_of_roster(const messages::Participant& peer) const {
  if (own_role() == Role::plant) {
    return roster_known() && peer.roster == roster_ ? Event::roster : Event::peer;
  }
  if (peer.role != Role::plant || !names_roster(peer)) return Event::peer;
  // Before the run begins, the plant may choose another roster.
  const bool with_self =
      is_running() ? peer.roster == roster_ : peer.roster[index(own_role())] == self_.who.instance;
  return with_self ? Event::roster : Event::other_roster;
}

bool Membership::handle(const messages::Stamp& stamp, const messages::Participant& peer,
                        std::string_view sender, Time now) {
  if (peer.instance == self_.who.instance || !peers_.is_new(peer)) return false;
  const auto lived = peers_.answered(peer, now);
  if (!lived && is_over(peer.state)) return false;  // no live process is there to be asked
  const Event event = lived ? event_of(stamp, peer) : Event::unproven;
  react(reaction(event, state_), stamp, peer, sender, lived, now);
  return lived && peer.instance == holder(peer.role);
}

void Membership::react(Reaction what, const messages::Stamp& stamp,
                       const messages::Participant& peer, std::string_view sender,
                       std::optional<Time> lived, Time now) {
  switch (what) {
    case Reaction::ignore:
      return;
    case Reaction::dissolve:
      return dissolve(now);
    case Reaction::forget:
      return peers_.forget(peer.instance);
    default:
      break;
  }
  const auto& [from, first] = peers_.remember(stamp, peer, sender, lived, now);
  if (first) announce_soon(now);  // a newcomer need not wait for the next period
  switch (what) {
    case Reaction::join:
      return join(from, now);
    case Reaction::agree:
      if (own_role() != Role::plant) return take_roster(peer.roster, now);
      confirmed_[index(peer.role)] = true;
      joined_ = std::ranges::count(confirmed_, true) == messages::num_roles - 1;
      return;
    case Reaction::yield:
      return fail({ExitCode::protocol_violated,
                   "{} has started run {} with a different {}; stop that run, or {}",
                   session::describe(from), from.run, messages::name(own_role()), beside_it},
                  now, true);
    case Reaction::contest:
      if (!precedes(stamp, from, now)) return;
      return fail({ExitCode::protocol_violated, "there is already {}; end it first, or {}",
                   session::describe(from), beside_it},
                  now, true);
    case Reaction::answer:
      return announce_soon(now);
    case Reaction::refuse:
      return fail(other_scenario(from, self_.who), now, true);
    case Reaction::note_finished:
      done_[index(peer.role)] = true;
      return;
    case Reaction::follow:
      return fail(consequence_of(from), now);
    default:
      return;  // observe: the process has been remembered above
  }
}

/// Handles an event of the clock or of this process.
void Membership::act(Event event, Time now, const std::optional<Failure>& failure) {
  switch (reaction(event, state_)) {
    case Reaction::start:
      return enter(ParticipantState::running, now);
    case Reaction::finish:
      complete_ = true;
      return enter(ParticipantState::finished, now);
    case Reaction::fail:
      return fail(*failure, now);
    case Reaction::reject:
      throw std::logic_error("a run was started before it was joined");
    default:
      return;
  }
}

void Membership::enter(ParticipantState state, Time now) {
  state_ = state;
  announce_at_ = now;
}

void Membership::fail(const Failure& failure, Time now, bool outside) {
  if (outside) outside_ = true;
  if (!failure_) failure_ = failure;
  enter(ParticipantState::fault, now);
}

void Membership::announce_soon(Time now) {
  announce_at_ = std::min(announce_at_, std::max(now, announced_ + shortest_reply_period));
}

void Membership::join(const Peer& peer, Time now) {
  if (own_role() == Role::plant) return choose_roster(now);
  const messages::Participant& who = peer.participant;
  // A plant with a roster begins, or has begun, with other processes.
  if (who.role != Role::plant || peer.run <= 0 || names_roster(who)) return;
  run_ = peer.run;
  peers_.set_holder(Role::plant, who.instance);
  enter(ParticipantState::ready, now);
}

void Membership::choose_roster(Time now) {
  messages::PerRole found{};
  for (const Peer& each : peers_.all()) {
    if (each.participant.role == Role::plant) continue;
    if (!each.lived || now - *each.lived >= forgotten_after) continue;
    std::int64_t& instance = found[index(each.participant.role)];
    if (instance != 0) return;  // one of the two processes will fail
    if (each.participant.state != ParticipantState::ready || each.run != run_) return;
    instance = each.participant.instance;
  }
  found[index(Role::plant)] = self_.who.instance;
  if (std::ranges::count(found, 0) > 0) return;
  roster_ = found;
  for (const Role role : all_roles) {
    if (role != Role::plant) peers_.set_holder(role, found[index(role)]);
  }
  enter(ParticipantState::ready, now);
}

void Membership::take_roster(const messages::PerRole& roster, Time now) {
  if (joined_ && roster == roster_) return;
  const bool known = std::ranges::all_of(all_roles, [&](Role role) {
    return role == own_role() || std::ranges::any_of(peers_.all(), [&](const Peer& each) {
             return each.lived && each.participant.instance == roster[index(role)];
           });
  });
  if (!known) return;
  roster_ = roster;
  for (const Role role : all_roles) {
    if (role != own_role()) peers_.set_holder(role, roster[index(role)]);
  }
  joined_ = true;
  announce_at_ = now;
}

/// Members that have confirmed the roster are ready and take another one.
void Membership::dissolve(Time now) {
  for (const Role role : all_roles) peers_.set_holder(role, 0);
  roster_ = {};
  confirmed_ = {};
  run_ = self_.run;
  enter(ParticipantState::waiting, now);
}

bool Membership::precedes(const messages::Stamp& stamp, const Peer& rival, Time now) const {
  // Once this process has joined, the roster names the process of this role. A rival's claims do
  // not matter.
  if (joined_ && roster_[index(own_role())] == self_.who.instance) return false;
  // A process in a roster does not yield to a process outside any roster.
  const auto rank = [](ParticipantState state, bool in_roster) {
    return state == ParticipantState::running ? 2 : in_roster ? 1 : 0;
  };
  const int own = rank(state_, roster_known());
  const int other = rank(rival.participant.state, names_roster(rival.participant));
  if (own != other) return own < other;
  // `older` is this process's age minus the rival's. The two may measure it differently by the
  // transit time of a message. After a second the margin is therefore doubled.
  const auto older = (now - start_) - std::chrono::microseconds(stamp.utime);
  const auto margin = now - rival.first_heard >= forgotten_after ? 2 * simultaneous : simultaneous;
  return std::chrono::abs(older) > margin ? older.count() < 0
                                          : self_.who.instance > rival.participant.instance;
}

void Membership::poll(Time now) {
  const auto passed = now - std::exchange(polled_, now);
  if (passed > 3 * period) peers_.excuse(passed - period);
  const auto matters = [&](Event event) { return reaction(event, state_) != Reaction::ignore; };
  for (const Role role : all_roles) {
    if (!watches(role)) continue;
    const auto silent = silence(role, now);
    if (!joined_ && silent && *silent >= forgotten_after && matters(Event::holder_gone)) {
      return dissolve(now);
    }
    if (!silent || *silent < self_.give_up || !matters(Event::holder_silent)) continue;
    return act(Event::holder_silent, now,
               Failure(ExitCode::peer_lost,
                       "{} has been silent for {:.3g} s; it has died or cannot be reached: see its "
                       "output",
                       describe(role), base::seconds_of(self_.give_up)));
  }
  peers_.forget_silent(now);
  if (matters(Event::wait_over) && self_.wait_limit && now - start_ >= *self_.wait_limit) {
    const auto roles = missing();
    act(Event::wait_over, now,
        Failure(ExitCode::peer_lost,
                "waited {:.3g} s for {}; start all four programs with the same scenario on one bus",
                base::seconds_of(*self_.wait_limit),
                roles.empty() ? "all to agree" : base::joined(roles)));
  }
}

void Membership::on_stopping(const Failure& failure, Time now) {
  if (!stopping_) stopping_ = failure;
  announce_at_ = now;
}

std::string Membership::unfinished() const {
  std::vector<std::string> result;
  for (const Role role : all_roles) {
    if (role != own_role() && !done_[index(role)]) result.push_back(describe(role));
  }
  return base::joined(result, " and ");
}

bool Membership::others_lack_ticks() const {
  return std::ranges::any_of(all_roles, [&](Role role) {
    const Peer* peer = peers_.find(role);
    return role != own_role() && !done_[index(role)] && (peer == nullptr || peer->tick < tick_);
  });
}

bool Membership::is_finish_acknowledged() const {
  const Peer* plant = peers_.find(Role::plant);
  if (plant == nullptr || end_counter_ == 0) return false;
  const std::size_t own = index(own_role());
  return plant->participant.heard_instance[own] == self_.who.instance &&
         plant->participant.heard_counter[own] >= end_counter_;
}

std::vector<std::string_view> Membership::missing() const {
  std::vector<std::string_view> result;
  for (const Role role : all_roles) {
    if (role != own_role() && peers_.find(role) == nullptr) result.push_back(messages::name(role));
  }
  return result;
}

std::string Membership::describe(Role role) const {
  const Peer* peer = peers_.find(role);
  return peer != nullptr ? session::describe(*peer) : fmt::format("the {}", messages::name(role));
}

bool Membership::knows(std::string_view sender) const {
  return std::ranges::any_of(peers_.all(), [&](const Peer& each) {
    return each.lived && each.participant.scenario_digest == self_.who.scenario_digest &&
           each.sender == sender;
  });
}

const Membership::Announcement& Membership::announce(Time now) {
  announced_ = now;
  announce_at_ = now + period;
  messages::Participant& mine = announcement_.participant;
  announcement_.stamp = {(now - start_) / std::chrono::microseconds(1), outside_ ? 0 : run_, tick_};
  mine.state = state_;
  mine.error_norm = error_norm_;
  mine.roster = roster_;
  peers_.fill_acknowledgements(mine, is_over(state_) && joined_, now);
  if (state_ == ParticipantState::finished && end_counter_ == 0) end_counter_ = mine.counter;
  // The announcement names the first cause; other failures may have followed.
  if (const auto& fault = stopping_ ? stopping_ : failure_; fault) {
    mine.fault_code = static_cast<int>(fault->code());
    mine.fault = std::string(fault->what()).substr(0, messages::max_participant_text);
  }
  return announcement_;
}

}  // namespace tachless::session
