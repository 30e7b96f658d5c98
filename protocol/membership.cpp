// More than 400 lines: recognising the events and carrying out the reactions is one state machine;
// who is known and who has proven to be there is protocol/peers.
#include "protocol/membership.h"

#include <fmt/core.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "diagnostics/text.h"
#include "diagnostics/time.h"

namespace tachless::protocol {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::ParticipantState;
using loop::Role;
using Event = MembershipEvent;
using Reaction = MembershipReaction;

constexpr std::array all_roles = {Role::plant, Role::reference, Role::controller, Role::logger};
// Replies to newcomers are limited to one in this time.
constexpr std::chrono::milliseconds shortest_reply_period{10};
constexpr std::string_view beside_it =
    "run beside it: with `tachless run --isolate`, or on another bus (--lcm-url)";

std::string in_quotes(const std::string& scenario) {
  return scenario.empty() ? "another scenario" : fmt::format("scenario '{}'", scenario);
}

bool is_over(ParticipantState state) {
  return state == ParticipantState::finished || state == ParticipantState::fault;
}

/// A process that ends because of its options, its scenario or its log.
bool is_bad_usage(const loop::Participant& peer) {
  return peer.state == ParticipantState::fault &&
         peer.fault_code == static_cast<int>(ExitCode::bad_usage);
}

}  // namespace

Membership::Membership(const Self& self, Time now)
    : self_(self),
      start_(now),
      announce_at_(now),
      announced_(now - period),
      polled_(now),
      run_(self.run),
      peers_(self.role, self.instance) {
  if ((self.role == Role::plant) != (self.run > 0)) {
    throw std::logic_error("a run is chosen by the plant and by nobody else");
  }
  loop::Participant& mine = announcement_.participant;
  mine.instance = self.instance;
  mine.scenario_digest = self.digest;
  mine.pid = self.pid;
  mine.role = self.role;
  mine.host = self.host;
  mine.scenario = self.scenario;
  mine.law = self.law.name;
  mine.measurement = self.law.measurement;
  mine.signals = self.law.signals;
}

bool Membership::in_own_run(const loop::Stamp& stamp, const loop::Participant& peer) const {
  const std::int64_t known = holder(peer.role);
  const bool in_run = self_.role == Role::plant ? joined_ : state_ != ParticipantState::waiting;
  return in_run && stamp.run == run_ && (known == 0 || known == peer.instance);
}

bool Membership::may_take_over(const loop::Stamp& stamp, const loop::Participant& peer) const {
  return self_.takeover && peer.role == Role::controller && stamp.run == run_ &&
         peer.scenario_digest == self_.digest && holder(peer.role) != peer.instance;
}

Event Membership::event_of(const loop::Stamp& stamp, const loop::Participant& peer,
                           Time now) const {
  const bool own_role = peer.role == self_.role;
  const bool own_scenario = peer.scenario_digest == self_.digest;
  if (is_over(peer.state)) {
    if (!own_role && in_own_run(stamp, peer)) {
      if (peer.state == ParticipantState::fault) return Event::member_failed;
      if (complete_) return Event::member_finished;
      return watches(peer.role) ? Event::early_finish : Event::departure;
    }
    if (!joined_ && holder(peer.role) == peer.instance) return Event::holder_gone;
    if (is_bad_usage(peer) && !own_role && !own_scenario) return Event::refusal;
    const bool successor = self_.role == Role::plant && may_take_over(stamp, peer);
    return is_bad_usage(peer) && successor ? Event::failed_successor : Event::departure;
  }
  if (own_role) return stamp.run == run_ ? Event::rival : Event::rival_elsewhere;
  if (!own_scenario) return Event::foreign_scenario;
  const std::int64_t known = holder(peer.role);
  if (known == 0 || known == peer.instance) return event_of_roster(peer);
  const auto silent = silence(peer.role, now);
  const bool free = !silent || *silent >= takeover_after;
  return may_take_over(stamp, peer) && free ? Event::successor : Event::newcomer;
}

Event Membership::event_of_roster(const loop::Participant& peer) const {
  if (self_.role == Role::plant) {
    return roster_known() && peer.roster == roster_ ? Event::roster : Event::peer;
  }
  if (peer.role != Role::plant || !names_roster(peer)) return Event::peer;
  // Before the run begins the plant may choose anew.
  const bool with_self =
      running()
          ? peer.roster == roster_
          : self_.resumes || peer.roster[static_cast<std::size_t>(self_.role)] == self_.instance;
  return with_self ? Event::roster : Event::other_roster;
}

void Membership::handle(const loop::Stamp& stamp, const loop::Participant& peer,
                        std::string_view sender, Time now) {
  if (peer.instance == self_.instance || !peers_.is_new(peer)) return;
  const auto lived = peers_.answered(peer);
  if (!lived && is_over(peer.state)) return;  // nobody is there to be asked
  const Event event = lived ? event_of(stamp, peer, now) : Event::unproven;
  if (lived && !is_over(state_) && peer.role == Role::controller &&
      holder(peer.role) == peer.instance) {
    failed_successor_.reset();  // the controller is still there
  }
  if (lived && !is_over(peer.state) && holder(peer.role) == peer.instance) {
    early_finish_[static_cast<std::size_t>(peer.role)].reset();
  }
  const auto peer_now = [&]() -> const Peer& {
    const auto [remembered, first] = peers_.remember(stamp, peer, sender, lived, now);
    if (first) announce_soon(now);  // a newcomer need not wait for our next one
    return remembered;
  };
  switch (reaction(event, state_)) {
    case Reaction::challenge:
    case Reaction::observe:
      peer_now();
      return;
    case Reaction::join:
      return join(peer_now(), now);
    case Reaction::agree: {
      const Peer& from = peer_now();
      if (self_.role == Role::plant) return confirm(from.participant.role);
      return take_roster(from.participant.roster, now);
    }
    case Reaction::dissolve:
      return dissolve(now);
    case Reaction::yield:
      return yield(peer_now(), now);
    case Reaction::contest:
      return contest(stamp, peer_now(), now);
    case Reaction::answer:
      peer_now();
      return announce_soon(now);
    case Reaction::refuse:
      return refuse(peer_now(), now);
    case Reaction::take_over:
      peer_now();
      peers_.set_holder(peer.role, peer.instance);
      failed_successor_.reset();
      ++takeovers_;
      return;
    case Reaction::note_finished:
      peer_now();
      return note_finished(peer.role);
    case Reaction::doubt: {
      peer_now();  // its announcements are still to be answered
      auto& since = early_finish_[static_cast<std::size_t>(peer.role)];
      if (!since) since = now;
      return;
    }
    case Reaction::follow:
      return fail(consequence_of(peer_now()), now);
    case Reaction::keep_failure:
      failed_successor_ = consequence_of(
          {peer, stamp.run, stamp.tick, std::string(sender), peer.counter, now, now, {}});
      return peers_.forget(peer.instance);
    case Reaction::forget:
      return peers_.forget(peer.instance);
    default:
      return;
  }
}

/// An event of the clock or of this process.
void Membership::act(Event event, const Failure* failure, Time now) {
  switch (reaction(event, state_)) {
    case Reaction::start:
      state_ = ParticipantState::running;
      announce_at_ = now;
      return;
    case Reaction::finish:
      state_ = ParticipantState::finished;
      complete_ = true;
      announce_at_ = now;
      return;
    case Reaction::fail:
      return fail(*failure, now);
    case Reaction::reject:
      throw std::logic_error("a run was started before it was joined");
    default:
      return;
  }
}

void Membership::announce_soon(Time now) {
  announce_at_ = std::min(announce_at_, std::max(now, announced_ + shortest_reply_period));
}

void Membership::join(const Peer& peer, Time now) {
  if (self_.role == Role::plant) return choose_roster(now);
  const loop::Participant& who = peer.participant;
  // A plant that has a roster begins, or has begun, with other processes.
  const bool late = names_roster(who) && !self_.resumes;
  if (who.role != Role::plant || peer.run <= 0 || late) return;
  run_ = peer.run;
  peers_.set_holder(Role::plant, who.instance);
  ready(now);
  if (names_roster(who)) take_roster(who.roster, now);
}

void Membership::choose_roster(Time now) {
  loop::PerRole found{};
  for (const Peer& each : peers_.all()) {
    if (each.participant.role == Role::plant) continue;
    if (!each.lived || now - *each.lived >= forgotten_after) continue;
    std::int64_t& instance = found[static_cast<std::size_t>(each.participant.role)];
    if (instance != 0) return;  // two of them; one will fail
    if (each.participant.state != ParticipantState::ready || each.run != run_) return;
    instance = each.participant.instance;
  }
  found[static_cast<std::size_t>(Role::plant)] = self_.instance;
  if (std::ranges::count(found, 0) > 0) return;
  roster_ = found;
  for (const Role role : all_roles) {
    if (role != Role::plant) peers_.set_holder(role, found[static_cast<std::size_t>(role)]);
  }
  ready(now);
}

void Membership::take_roster(const loop::PerRole& roster, Time now) {
  if (joined_ && roster == roster_) return;
  roster_ = roster;
  for (const Role role : all_roles) {
    if (role != self_.role) peers_.set_holder(role, roster[static_cast<std::size_t>(role)]);
  }
  joined_ = true;
  announce_at_ = now;
}

void Membership::confirm(Role role) {
  confirmed_[static_cast<std::size_t>(role)] = true;
  joined_ = std::ranges::count(confirmed_, true) == loop::num_roles - 1;
}

/// Those who have confirmed it are ready, and take another.
void Membership::dissolve(Time now) {
  for (const Role role : all_roles) peers_.set_holder(role, 0);
  roster_ = {};
  confirmed_ = {};
  run_ = self_.run;
  state_ = ParticipantState::waiting;
  announce_at_ = now;
}

void Membership::yield(const Peer& plant, Time now) {
  outside_ = true;
  fail(Failure(ExitCode::protocol_violated,
               "{} begins run {} with another {}; end that first, or {}", describe(plant),
               plant.run, loop::name(self_.role), beside_it),
       now);
}

void Membership::ready(Time now) {
  state_ = ParticipantState::ready;
  announce_at_ = now;
}

void Membership::contest(const loop::Stamp& stamp, const Peer& rival, Time now) {
  // A member of a run never yields to who is not in it.
  const auto rank = [](ParticipantState state, bool in_roster) {
    return state == ParticipantState::running ? 2 : in_roster ? 1 : 0;
  };
  const int own = rank(state_, roster_known());
  const int other = rank(rival.participant.state, names_roster(rival.participant));
  bool yields = own < other;
  if (own == other) {
    // How much older this process is. The two may see the difference unlike by the time a message
    // takes; a process still heard after a second tells that more counts as simultaneous.
    const auto older = (now - start_) - std::chrono::microseconds(stamp.utime);
    const auto margin =
        now - rival.first_heard >= forgotten_after ? 2 * simultaneous : simultaneous;
    yields = std::chrono::abs(older) > margin ? older.count() < 0
                                              : self_.instance > rival.participant.instance;
  }
  if (!yields) return;
  outside_ = true;
  fail(Failure(ExitCode::protocol_violated, "there is already {}; end it first, or {}",
               describe(rival), beside_it),
       now);
}

void Membership::refuse(const Peer& other, Time now) {
  outside_ = true;
  fail(diagnostics::bad_usage("{} runs {} (digest {:016x}), this {} runs {} (digest {:016x}); give "
                              "all four programs the same file and the same --set",
                              describe(other), in_quotes(other.participant.scenario),
                              static_cast<std::uint64_t>(other.participant.scenario_digest),
                              loop::name(self_.role), in_quotes(self_.scenario),
                              static_cast<std::uint64_t>(self_.digest)),
       now);
}

void Membership::poll(Time now) {
  const auto passed = now - std::exchange(polled_, now);
  if (passed > 3 * period) {
    peers_.excuse(passed - period);
    for (auto& since : early_finish_) {
      if (since) *since += passed - period;
    }
  }
  const auto matters = [&](Event event) { return reaction(event, state_) != Reaction::ignore; };
  for (const Role role : all_roles) {
    if (!watches(role)) continue;
    const auto silent = silence(role, now);
    const bool begins = self_.role == Role::plant && !joined_;
    if (begins && silent && *silent >= forgotten_after && matters(Event::holder_gone)) {
      return dissolve(now);
    }
    const auto& finish = early_finish_[static_cast<std::size_t>(role)];
    if (finish && now - *finish >= finish_stands_after && matters(Event::finish_stands)) {
      if (complete_) return note_finished(role);  // it was early then, and may not be said again
      const Failure failure = incomplete(role);
      return act(Event::finish_stands, &failure, now);
    }
    if (!silent || *silent < self_.give_up || !matters(Event::holder_silent)) continue;
    const Failure lost(
        ExitCode::peer_lost,
        fmt::format(
            "{} has been silent for {:.3g} s; it has died or cannot be reached: see its output",
            describe(role), diagnostics::seconds_of(self_.give_up)));
    return act(Event::holder_silent, &lost, now);
  }
  if (failed_successor_ && silence(Role::controller, now) >= takeover_after) {
    const Failure failed = *failed_successor_;
    return act(Event::takeover_failed, &failed, now);
  }
  peers_.forget_silent(now);
  if (matters(Event::wait_over) && self_.wait_limit && now - start_ >= *self_.wait_limit) {
    std::vector<std::string_view> roles;
    for (const Role role : missing()) roles.push_back(loop::name(role));
    const Failure over(
        ExitCode::peer_lost,
        fmt::format(
            "waited {:.3g} s for {}; start all four programs with the same scenario on one bus",
            diagnostics::seconds_of(*self_.wait_limit),
            roles.empty() ? "all to agree" : diagnostics::joined(roles)));
    act(Event::wait_over, &over, now);
  }
}

void Membership::stopping(const Failure& failure, Time now) {
  if (!stopping_) stopping_ = failure;
  announce_at_ = now;
}

void Membership::fail(const Failure& failure, Time now) {
  if (!failure_) failure_ = failure;
  state_ = ParticipantState::fault;
  announce_at_ = now;
}

Failure Membership::consequence_of(const Peer& failed) {
  ExitCode code = ExitCode::peer_lost;
  for (const ExitCode passed_on : {ExitCode::protocol_violated, ExitCode::protective_stop}) {
    if (failed.participant.fault_code == static_cast<int>(passed_on)) code = passed_on;
  }
  const std::string& fault = failed.participant.fault;
  return {code, fmt::format("ended because of {}: {}", describe(failed),
                            fault.empty() ? "it does not say why" : fault)};
}

Failure Membership::incomplete(Role role) const {
  return {ExitCode::protocol_violated,
          fmt::format("{} says that it has finished, but this {} has got no further than tick {}: "
                      "somebody else has spoken for one of the run's processes; find it with "
                      "`tachless watch`, or use a key (--key-file)",
                      describe(role), loop::name(self_.role), tick_)};
}

bool Membership::all_finished() const {
  return std::ranges::all_of(all_roles, [this](Role role) {
    return role == self_.role || done_[static_cast<std::size_t>(role)];
  });
}

bool Membership::end_is_known() const {
  const Peer* plant = peers_.find(Role::plant);
  if (plant == nullptr || end_counter_ == 0) return false;
  const auto own = static_cast<std::size_t>(self_.role);
  return plant->participant.heard_instance[own] == self_.instance &&
         plant->participant.heard_counter[own] >= end_counter_;
}

std::vector<Role> Membership::missing() const {
  std::vector<Role> result;
  for (const Role role : all_roles) {
    if (role != self_.role && peers_.find(role) == nullptr) result.push_back(role);
  }
  return result;
}

std::int64_t Membership::truth_digest() const {
  const Peer* plant = peers_.find(Role::plant);
  return plant != nullptr ? plant->participant.truth_digest : 0;
}

loop::LawInfo Membership::law() const {
  const Peer* controller = peers_.find(Role::controller);
  if (controller == nullptr) return {};
  const loop::Participant& said = controller->participant;
  return {said.law, said.measurement, said.signals};
}

std::string Membership::describe(const Peer& peer) {
  const loop::Participant& who = peer.participant;
  return fmt::format("the {} (process {}{}{}{}{})", loop::name(who.role), who.pid,
                     who.host.empty() ? "" : " on ", who.host, peer.sender.empty() ? "" : ", ",
                     peer.sender);
}

std::string Membership::describe(Role role) const {
  const Peer* peer = peers_.find(role);
  return peer != nullptr ? describe(*peer) : fmt::format("the {}", loop::name(role));
}

std::optional<std::chrono::nanoseconds> Membership::silence(Role role, Time now) const {
  const Peer* peer = peers_.find(role);
  if (peer == nullptr) return std::nullopt;
  return now - *peer->lived;
}

std::int64_t Membership::tick_of(Role role) const {
  const Peer* peer = peers_.find(role);
  return peer != nullptr ? peer->tick : -1;
}

bool Membership::is_from(Role role, std::string_view sender) const {
  const Peer* peer = peers_.find(role);
  return peer != nullptr && peer->sender == sender;
}

bool Membership::knows(std::string_view sender) const {
  return std::ranges::any_of(peers_.all(), [&](const Peer& each) {
    return each.lived && each.participant.scenario_digest == self_.digest && each.sender == sender;
  });
}

const Membership::Announcement& Membership::announce(Time now) {
  announced_ = now;
  announce_at_ = now + period;
  announcement_.stamp.utime = (now - start_) / std::chrono::microseconds(1);
  announcement_.stamp.run = outside_ ? 0 : run_;
  announcement_.stamp.tick = tick_;
  announcement_.participant.state = state_;
  announcement_.participant.error_norm = error_norm_;
  announcement_.participant.roster = roster_;
  peers_.sign(announcement_.participant, is_over(state_) && joined_, now);
  if (state_ == ParticipantState::finished && end_counter_ == 0) {
    end_counter_ = announcement_.participant.counter;
  }
  // The first cause: others may have ended since.
  if (const auto& fault = stopping_ ? stopping_ : failure_; fault) {
    announcement_.participant.fault_code = static_cast<int>(fault->code());
    announcement_.participant.fault =
        std::string(fault->what()).substr(0, loop::max_participant_text);
  }
  return announcement_;
}

}  // namespace tachless::protocol
