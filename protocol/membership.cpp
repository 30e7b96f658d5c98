#include "protocol/membership.h"

#include <fmt/core.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "diagnostics/text.h"

namespace tachless::protocol {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::ParticipantState;
using loop::Role;
using Event = MembershipEvent;
using Reaction = MembershipReaction;

constexpr std::array all_roles = {Role::plant, Role::reference, Role::controller, Role::logger};
constexpr std::size_t most_peers = 32;  // a flood of announcements must not grow our memory
// Replies to newcomers during a run are limited to one in this time.
constexpr std::chrono::milliseconds shortest_reply_period{10};

std::string in_quotes(const std::string& scenario) {
  return scenario.empty() ? "another scenario" : fmt::format("scenario '{}'", scenario);
}

double seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
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
    : self_(self), start_(now), announce_at_(now), polled_(now), run_(self.run) {
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
  mine.measurement = self.measurement;
  mine.signals = self.signals;
}

bool Membership::in_joined_run(const loop::Stamp& stamp, const loop::Participant& peer) const {
  const std::int64_t known = holder(peer.role);
  return joined_ && stamp.run == run_ && (known == 0 || known == peer.instance);
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
    if (!own_role && in_joined_run(stamp, peer)) {
      if (peer.state == ParticipantState::fault) return Event::member_failed;
      if (complete_) return Event::member_finished;
      return watches(peer.role) ? Event::early_finish : Event::departure;
    }
    if (is_bad_usage(peer) && !own_role && !own_scenario) return Event::refusal;
    const bool successor = self_.role == Role::plant && may_take_over(stamp, peer);
    return is_bad_usage(peer) && successor ? Event::failed_successor : Event::departure;
  }
  if (own_role) return stamp.run == run_ ? Event::rival : Event::rival_elsewhere;
  if (!own_scenario) return Event::foreign_scenario;
  const std::int64_t known = holder(peer.role);
  if (known == 0 || known == peer.instance) return Event::peer;
  const auto silent = silence(peer.role, now);
  const bool free = !silent || *silent >= takeover_after;
  return may_take_over(stamp, peer) && free ? Event::successor : Event::newcomer;
}

void Membership::handle(const loop::Stamp& stamp, const loop::Participant& peer,
                        std::string_view sender, Time now) {
  if (peer.instance == self_.instance) return;
  const Event event = event_of(stamp, peer, now);
  if (!is_over(state_) && peer.role == Role::controller && holder(peer.role) == peer.instance) {
    failed_successor_.reset();  // the controller is still there
  }
  if (!is_over(peer.state) && holder(peer.role) == peer.instance) {
    early_finish_[static_cast<std::size_t>(peer.role)].reset();
  }
  const auto peer_now = [&]() -> Peer& { return remember(stamp, peer, sender, now); };
  switch (reaction(event, state_)) {
    case Reaction::observe:
      return observe(peer_now());
    case Reaction::join:
      return join(peer_now(), now);
    case Reaction::contest:
      return contest(stamp, peer_now(), now);
    case Reaction::answer:
      announce_at_ =
          std::min(announce_at_, std::max(now, announce_at_ - period + shortest_reply_period));
      return;
    case Reaction::refuse:
      return refuse(peer_now(), now);
    case Reaction::take_over:
      holder(peer.role) = peer.instance;
      failed_successor_.reset();
      ++takeovers_;
      return observe(peer_now());
    case Reaction::note_finished:
      done_[static_cast<std::size_t>(peer.role)] = true;
      plant_finished_ = plant_finished_ || peer.role == Role::plant;
      return is_over(state_) ? void() : forget(peer);
    case Reaction::doubt: {
      auto& since = early_finish_[static_cast<std::size_t>(peer.role)];
      if (!since) since = now;
      return;
    }
    case Reaction::follow:
      return fail(consequence_of(peer_now()), now);
    case Reaction::keep_failure:
      failed_successor_ =
          consequence_of({peer, stamp.run, stamp.tick, std::string(sender), now, now});
      return forget(peer);
    case Reaction::forget:
      return forget(peer);
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

Membership::Peer& Membership::remember(const loop::Stamp& stamp, const loop::Participant& peer,
                                       std::string_view sender, Time now) {
  const auto known = std::ranges::find_if(
      peers_, [&](const Peer& each) { return each.participant.instance == peer.instance; });
  if (known != peers_.end()) {
    known->participant = peer;
    known->run = stamp.run;
    known->tick = stamp.tick;
    known->heard = now;
    return *known;
  }
  if (peers_.size() >= most_peers) {
    // The one heard longest ago is dropped, unless it holds a role.
    peers_.erase(std::ranges::min_element(peers_, {}, [&](const Peer& each) {
      const bool holds = holder(each.participant.role) == each.participant.instance;
      return holds ? Time::max() : each.heard;
    }));
  } else {
    announce_at_ = std::min(announce_at_, now);  // a newcomer need not wait for our next one
  }
  peers_.push_back({peer, stamp.run, stamp.tick, std::string(sender), now, now});
  return peers_.back();
}

void Membership::forget(const loop::Participant& peer) {
  if (holder(peer.role) == peer.instance) return;
  std::erase_if(peers_,
                [&](const Peer& each) { return each.participant.instance == peer.instance; });
}

void Membership::forget_silent(Time now) {
  std::erase_if(peers_, [&](const Peer& each) { return now - each.heard >= forgotten_after; });
}

/// The plant knows all holders from the moment it has joined; the others learn them from who runs.
void Membership::observe(const Peer& peer) {
  const loop::Participant& who = peer.participant;
  if (self_.role != Role::plant && joined_ && peer.run == run_ && holder(who.role) == 0 &&
      who.state == ParticipantState::running) {
    holder(who.role) = who.instance;
  }
}

void Membership::join(const Peer& peer, Time now) {
  if (self_.role == Role::plant) return join_as_plant(now);
  const loop::Participant& who = peer.participant;
  // A plant that is running has started with other processes.
  const bool late = who.state == ParticipantState::running && !self_.resumes;
  if (who.role != Role::plant || peer.run <= 0 || late) return;
  run_ = peer.run;
  holder(Role::plant) = who.instance;
  ready(now);
}

void Membership::join_as_plant(Time now) {
  forget_silent(now);
  std::array<std::int64_t, loop::num_roles> found{};
  for (const Peer& each : peers_) {
    if (each.participant.role == Role::plant) continue;
    std::int64_t& instance = found[static_cast<std::size_t>(each.participant.role)];
    if (instance != 0) return;  // two of them; one will fail
    if (each.participant.state != ParticipantState::ready || each.run != run_) return;
    instance = each.participant.instance;
  }
  if (std::ranges::count(found, 0) > 1) return;  // the plant's own place
  holders_ = found;
  ready(now);
}

void Membership::ready(Time now) {
  joined_ = true;
  state_ = ParticipantState::ready;
  announce_at_ = now;
}

void Membership::contest(const loop::Stamp& stamp, const Peer& rival, Time now) {
  const bool rival_runs = rival.participant.state == ParticipantState::running;
  bool yields = rival_runs;
  if (running() == rival_runs) {
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
  fail(Failure(ExitCode::protocol_violated,
               fmt::format("there is already {}; end it first, or use another bus (--lcm-url)",
                           describe(rival))),
       now);
}

void Membership::refuse(const Peer& other, Time now) {
  outside_ = true;
  fail(
      Failure(ExitCode::bad_usage,
              fmt::format("{} runs {} (digest {:016x}), this {} runs {} (digest {:016x}); give all "
                          "four programs the same file and the same --set",
                          describe(other), in_quotes(other.participant.scenario),
                          static_cast<std::uint64_t>(other.participant.scenario_digest),
                          loop::name(self_.role), in_quotes(self_.scenario),
                          static_cast<std::uint64_t>(self_.digest))),
      now);
}

void Membership::poll(Time now) {
  const auto passed = now - std::exchange(polled_, now);
  if (passed > 3 * period) {
    for (Peer& each : peers_) each.heard += passed - period;
    for (auto& since : early_finish_) {
      if (since) *since += passed - period;
    }
  }
  const auto matters = [&](Event event) { return reaction(event, state_) != Reaction::ignore; };
  for (const Role role : all_roles) {
    if (!watches(role)) continue;
    const auto& finish = early_finish_[static_cast<std::size_t>(role)];
    if (finish && now - *finish >= finish_stands_after && matters(Event::finish_stands)) {
      const Failure failure = incomplete(role);
      return act(Event::finish_stands, &failure, now);
    }
    const auto silent = silence(role, now);
    if (!silent || *silent < self_.give_up || !matters(Event::holder_silent)) continue;
    const Failure lost(
        ExitCode::peer_lost,
        fmt::format("{} has been silent for {:.3g} s; it has died or cannot be reached: see its "
                    "output",
                    describe(role), seconds(self_.give_up)));
    return act(Event::holder_silent, &lost, now);
  }
  if (failed_successor_ && silence(Role::controller, now) >= takeover_after) {
    const Failure failed = *failed_successor_;
    return act(Event::takeover_failed, &failed, now);
  }
  if (!joined_) forget_silent(now);
  if (matters(Event::wait_over) && self_.wait_limit && now - start_ >= *self_.wait_limit) {
    std::vector<std::string_view> roles;
    for (const Role role : missing()) roles.push_back(loop::name(role));
    const Failure over(
        ExitCode::peer_lost,
        fmt::format("waited {:.3g} s for {}; start all four programs with the same scenario on one "
                    "bus",
                    seconds(*self_.wait_limit),
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
  return {code, fmt::format("ended because of {}: {}", describe(failed), failed.participant.fault)};
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

std::vector<Role> Membership::missing() const {
  std::vector<Role> result;
  for (const Role role : all_roles) {
    if (role != self_.role && find(role) == nullptr) result.push_back(role);
  }
  return result;
}

const Membership::Peer* Membership::find(Role role) const {
  const auto found = std::ranges::find_if(peers_, [&](const Peer& each) {
    return each.participant.role == role &&
           (holder(role) == 0 || holder(role) == each.participant.instance);
  });
  return found != peers_.end() ? &*found : nullptr;
}

std::string Membership::measurement() const {
  const Peer* controller = find(Role::controller);
  return controller != nullptr ? controller->participant.measurement : std::string();
}

std::string Membership::signals() const {
  const Peer* controller = find(Role::controller);
  return controller != nullptr ? controller->participant.signals : std::string();
}

std::string Membership::describe(const Peer& peer) {
  const loop::Participant& who = peer.participant;
  return fmt::format("the {} (process {}{}{}{}{})", loop::name(who.role), who.pid,
                     who.host.empty() ? "" : " on ", who.host, peer.sender.empty() ? "" : ", ",
                     peer.sender);
}

std::string Membership::describe(Role role) const {
  const Peer* peer = find(role);
  return peer != nullptr ? describe(*peer) : fmt::format("the {}", loop::name(role));
}

std::optional<std::chrono::nanoseconds> Membership::silence(Role role, Time now) const {
  const Peer* peer = find(role);
  if (peer == nullptr) return std::nullopt;
  return now - peer->heard;
}

std::int64_t Membership::tick_of(Role role) const {
  const Peer* peer = find(role);
  return peer != nullptr ? peer->tick : -1;
}

bool Membership::is_from(Role role, std::string_view sender) const {
  const Peer* peer = find(role);
  return peer != nullptr && peer->sender == sender;
}

bool Membership::knows(std::string_view sender) const {
  return std::ranges::any_of(peers_, [&](const Peer& each) {
    return each.participant.scenario_digest == self_.digest && each.sender == sender;
  });
}

const Membership::Announcement& Membership::announce(Time now) {
  announce_at_ = now + period;
  announcement_.stamp.utime = (now - start_) / std::chrono::microseconds(1);
  announcement_.stamp.run = outside_ ? 0 : run_;
  announcement_.stamp.tick = tick_;
  announcement_.participant.state = state_;
  announcement_.participant.error_norm = error_norm_;
  // The first cause: others may have ended since.
  if (const auto& fault = stopping_ ? stopping_ : failure_; fault) {
    announcement_.participant.fault_code = static_cast<int>(fault->code());
    announcement_.participant.fault =
        std::string(fault->what()).substr(0, loop::max_participant_text);
  }
  return announcement_;
}

}  // namespace tachless::protocol
