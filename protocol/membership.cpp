#include "protocol/membership.h"

#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <utility>

namespace tachless::protocol {
namespace {

using loop::ParticipantState;
using loop::Role;

constexpr std::array all_roles = {Role::plant, Role::reference, Role::controller, Role::logger};
constexpr std::size_t most_peers = 32;  // a flood of strangers must not grow our memory

std::size_t index(Role role) { return static_cast<std::size_t>(role); }

std::string digest_text(std::int64_t digest) {
  std::array<char, 17> text{};
  std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(digest));
  return text.data();
}

std::string quoted(const std::string& scenario) {
  return scenario.empty() ? "another scenario" : "scenario '" + scenario + "'";
}

/// The exit code of a process that ends because of another's fault.
diagnostics::ExitCode consequence(int fault_code) {
  switch (fault_code) {
    case static_cast<int>(diagnostics::ExitCode::protocol_violated):
      return diagnostics::ExitCode::protocol_violated;
    case static_cast<int>(diagnostics::ExitCode::protective_stop):
      return diagnostics::ExitCode::protective_stop;
    default:
      return diagnostics::ExitCode::peer_lost;
  }
}

std::string seconds(std::chrono::nanoseconds duration) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.3g s",
                std::chrono::duration<double>(duration).count());
  return text.data();
}

}  // namespace

Membership::Membership(const Self& self, Time now)
    : self_(self), start_(now), announce_at_(now), checked_(now), run_(self.run) {
  if ((self.role == Role::plant) != (self.run > 0)) {
    throw std::logic_error("a run is chosen by the plant and by nobody else");
  }
  loop::Participant& mine = said_.participant;
  mine.instance = self.instance;
  mine.scenario_digest = self.digest;
  mine.pid = self.pid;
  mine.role = self.role;
  mine.host = self.host;
  mine.scenario = self.scenario;
  mine.measurement = self.measurement;
  mine.signals = self.signals;
}

bool Membership::over() const {
  return state_ == ParticipantState::finished || state_ == ParticipantState::fault;
}

bool Membership::in_our_run(const loop::Stamp& stamp, const loop::Participant& peer) const {
  const std::int64_t player = cast_[index(peer.role)];
  return met_ && stamp.run == run_ && (player == 0 || player == peer.instance);
}

void Membership::hear(const loop::Stamp& stamp, const loop::Participant& peer,
                      std::string_view sender, Time now) {
  if (peer.instance == self_.instance || state_ == ParticipantState::fault) return;
  const bool gone =
      peer.state == ParticipantState::finished || peer.state == ParticipantState::fault;

  if (peer.role != self_.role && in_our_run(stamp, peer)) {
    if (peer.state == ParticipantState::finished) {
      done_[index(peer.role)] = true;
      plant_finished_ = plant_finished_ || peer.role == Role::plant;
    } else if (peer.state == ParticipantState::fault && !over()) {
      const Peer& other = note(stamp, peer, sender, now);
      return fail(because_of(other), now);
    }
  }
  if (over()) return;
  if (peer.role == Role::controller && cast_[index(peer.role)] == peer.instance) {
    failed_successor_.reset();  // there is no need of one
  }

  const bool differs = peer.scenario_digest != self_.digest;
  if (gone) {
    const bool refused = peer.state == ParticipantState::fault &&
                         peer.fault_code == static_cast<int>(diagnostics::ExitCode::bad_usage);
    // One that refused us says so while it leaves.
    if (refused && peer.role != self_.role && differs && !running()) {
      return refuse(note(stamp, peer, sender, now), now);
    }
    if (refused && self_.role == Role::plant && would_succeed(stamp, peer)) {
      failed_successor_ = because_of({peer, stamp.run, stamp.tick, std::string(sender), now, now});
    }
    if (cast_[index(peer.role)] != peer.instance) {
      std::erase_if(peers_,
                    [&](const Peer& each) { return each.participant.instance == peer.instance; });
    }
    return;
  }
  if (running() && cast_[index(peer.role)] != 0 && cast_[index(peer.role)] != peer.instance) {
    // A newcomer; the one it wants to replace will tell it, unless that is gone.
    if (!succeeds(stamp, peer, now)) return;
    cast_[index(peer.role)] = peer.instance;
    failed_successor_.reset();
    ++successions_;
  }
  // Who plays in a run gives way to nobody outside it: the newcomer is told at once, before it can
  // begin a run of its own, and gives way. However many knock, the answer is one each 10 ms.
  if (running() && peer.role == self_.role && stamp.run != run_) {
    const Time last = announce_at_ - period;
    announce_at_ = std::min(announce_at_, std::max(now, last + std::chrono::milliseconds(10)));
    return;
  }

  const Peer& other = note(stamp, peer, sender, now);
  if (peer.role == self_.role) return contest(stamp, other, now);
  if (differs) {
    if (!running()) refuse(other, now);
    return;
  }
  if (self_.role == Role::plant) {
    look_for_all(now);
  } else if (peer.role == Role::plant) {
    adopt(stamp, peer, now);
  }
  if (met_ && stamp.run == run_ && cast_[index(peer.role)] == 0 && self_.role != Role::plant &&
      peer.state == ParticipantState::running) {
    cast_[index(peer.role)] = peer.instance;
  }
}

Membership::Peer& Membership::note(const loop::Stamp& stamp, const loop::Participant& peer,
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
    // The one heard longest ago makes room, unless it plays a part.
    const auto oldest = std::ranges::min_element(peers_, {}, [&](const Peer& each) {
      const bool cast = cast_[index(each.participant.role)] == each.participant.instance;
      return cast ? Time::max() : each.heard;
    });
    peers_.erase(oldest);
  } else {
    announce_at_ = std::min(announce_at_, now);  // a newcomer need not wait for our next one
  }
  peers_.push_back({peer, stamp.run, stamp.tick, std::string(sender), now, now});
  return peers_.back();
}

diagnostics::Failure Membership::because_of(const Peer& failed) {
  return {consequence(failed.participant.fault_code),
          "ended because of " + describe(failed) + ": " + failed.participant.fault};
}

bool Membership::would_succeed(const loop::Stamp& stamp, const loop::Participant& peer) const {
  return self_.succession && running() && peer.role == Role::controller && stamp.run == run_ &&
         peer.scenario_digest == self_.digest && cast_[index(peer.role)] != peer.instance;
}

bool Membership::succeeds(const loop::Stamp& stamp, const loop::Participant& peer, Time now) const {
  if (!would_succeed(stamp, peer)) return false;
  const auto silent = silence(peer.role, now);
  return !silent || *silent >= succession_after;
}

void Membership::contest(const loop::Stamp& stamp, const Peer& other, Time now) {
  const bool other_runs = other.participant.state == ParticipantState::running;
  bool gives_way = other_runs;
  if (running() == other_runs) {
    // How much older this process is. The two may see the difference unlike by the time a message
    // takes; who still meets the other after a second counts more as simultaneous.
    const auto older = (now - start_) - std::chrono::microseconds(stamp.utime);
    const auto margin =
        now - other.first_heard >= forgotten_after ? 2 * simultaneous : simultaneous;
    gives_way = std::chrono::abs(older) > margin ? older.count() < 0
                                                 : self_.instance > other.participant.instance;
  }
  if (!gives_way) return;
  in_the_way_ = true;
  fail(diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                            "there is already " + describe(other) +
                                "; end it first, or use another bus (--lcm-url)"),
       now);
}

void Membership::refuse(const Peer& other, Time now) {
  in_the_way_ = true;
  fail(diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                            describe(other) + " runs " + quoted(other.participant.scenario) +
                                " (digest " + digest_text(other.participant.scenario_digest) +
                                "), this " + std::string(loop::name(self_.role)) + " runs " +
                                quoted(self_.scenario) + " (digest " + digest_text(self_.digest) +
                                "); give all four programs the same file and the same --set"),
       now);
}

void Membership::adopt(const loop::Stamp& stamp, const loop::Participant& plant, Time now) {
  // A plant that is under way has started with somebody else.
  if (met_ || stamp.run <= 0) return;
  if (plant.state == ParticipantState::running && !self_.resumes) return;
  run_ = stamp.run;
  met_ = true;
  cast_[index(Role::plant)] = plant.instance;
  state_ = ParticipantState::ready;
  announce_at_ = now;
}

void Membership::look_for_all(Time now) {
  if (met_) return;
  std::erase_if(peers_, [&](const Peer& each) { return now - each.heard >= forgotten_after; });
  std::array<std::int64_t, loop::num_roles> found{};
  for (const Peer& each : peers_) {
    const std::size_t role = index(each.participant.role);
    if (each.participant.role == Role::plant) continue;
    if (found[role] != 0) return;  // two of them; one will give way
    if (each.participant.state != ParticipantState::ready || each.run != run_) return;
    found[role] = each.participant.instance;
  }
  for (const Role role : all_roles) {
    if (role != Role::plant && found[index(role)] == 0) return;
  }
  cast_ = found;
  met_ = true;
  state_ = ParticipantState::ready;
  announce_at_ = now;
}

void Membership::check(Time now) {
  const auto unchecked = now - std::exchange(checked_, now);
  if (unchecked > 3 * period) {
    for (Peer& each : peers_) each.heard += unchecked - period;
  }
  if (over()) return;
  for (const Role role : all_roles) {
    const std::int64_t player = cast_[index(role)];
    // The plant looks after all, the others after the plant.
    if (player == 0 || (self_.role != Role::plant && role != Role::plant)) continue;
    const auto silent = silence(role, now);
    if (silent && *silent >= self_.give_up) {
      return fail(
          diagnostics::Failure(diagnostics::ExitCode::peer_lost,
                               describe(role) + " has been silent for " + seconds(self_.give_up) +
                                   "; it has died or cannot be reached: see its output"),
          now);
    }
  }
  if (failed_successor_ && silence(Role::controller, now) >= succession_after) {
    return fail(diagnostics::Failure(*failed_successor_), now);
  }
  if (!met_) {
    std::erase_if(peers_, [&](const Peer& each) { return now - each.heard >= forgotten_after; });
  }
  if (!running() && self_.wait_limit && now - start_ >= *self_.wait_limit) {
    std::string roles;
    for (const Role role : missing()) {
      roles += (roles.empty() ? "" : ", ") + std::string(loop::name(role));
    }
    fail(diagnostics::Failure(diagnostics::ExitCode::peer_lost,
                              "waited " + seconds(*self_.wait_limit) + " for " +
                                  (roles.empty() ? "all to agree" : roles) +
                                  "; start all four programs with the same scenario on one bus"),
         now);
  }
}

void Membership::started(Time now) {
  if (!met_) throw std::logic_error("a run was started before all had met");
  if (running() || over()) return;
  state_ = ParticipantState::running;
  announce_at_ = now;
}

void Membership::progressed(std::int64_t tick, double error_norm) {
  tick_ = tick;
  error_norm_ = error_norm;
}

void Membership::finished(Time now) {
  state_ = ParticipantState::finished;
  announce_at_ = now;
}

void Membership::failed(const diagnostics::Failure& failure, Time now) { fail(failure, now); }

void Membership::stopping(const diagnostics::Failure& failure, Time now) {
  if (!stopping_) stopping_ = failure;
  announce_at_ = now;
}

void Membership::fail(const diagnostics::Failure& failure, Time now) {
  if (!failure_) failure_ = failure;
  state_ = ParticipantState::fault;
  announce_at_ = now;
}

bool Membership::all_finished() const {
  return std::ranges::all_of(
      all_roles, [this](Role role) { return role == self_.role || done_[index(role)]; });
}

std::int64_t Membership::plant_instance() const {
  return self_.role == Role::plant ? self_.instance : cast_[index(Role::plant)];
}

std::vector<Role> Membership::missing() const {
  std::vector<Role> result;
  for (const Role role : all_roles) {
    if (role != self_.role && holder(role) == nullptr) result.push_back(role);
  }
  return result;
}

const Membership::Peer* Membership::holder(Role role) const {
  const std::int64_t player = cast_[index(role)];
  for (const Peer& each : peers_) {
    if (each.participant.role != role) continue;
    if (player == 0 || player == each.participant.instance) return &each;
  }
  return nullptr;
}

std::string Membership::measurement() const {
  const Peer* controller = holder(Role::controller);
  return controller != nullptr ? controller->participant.measurement : std::string();
}

std::string Membership::signals() const {
  const Peer* controller = holder(Role::controller);
  return controller != nullptr ? controller->participant.signals : std::string();
}

std::string Membership::describe(const Peer& peer) {
  const loop::Participant& who = peer.participant;
  return "the " + std::string(loop::name(who.role)) + " (process " + std::to_string(who.pid) +
         (who.host.empty() ? "" : " on " + who.host) +
         (peer.sender.empty() ? "" : ", " + peer.sender) + ")";
}

std::string Membership::describe(Role role) const {
  const Peer* peer = holder(role);
  return peer != nullptr ? describe(*peer) : "the " + std::string(loop::name(role));
}

std::optional<std::chrono::nanoseconds> Membership::silence(Role role, Time now) const {
  const Peer* peer = holder(role);
  if (peer == nullptr) return std::nullopt;
  return now - peer->heard;
}

std::int64_t Membership::tick_of(Role role) const {
  const Peer* peer = holder(role);
  return peer != nullptr ? peer->tick : -1;
}

bool Membership::is_from(Role role, std::string_view sender) const {
  const Peer* peer = holder(role);
  return peer != nullptr && peer->sender == sender;
}

bool Membership::knows(std::string_view sender) const {
  return std::ranges::any_of(peers_, [&](const Peer& each) {
    return each.participant.scenario_digest == self_.digest && each.sender == sender;
  });
}

const Membership::Announcement& Membership::announce(Time now) {
  announce_at_ = now + period;
  said_.stamp.utime = (now - start_) / std::chrono::microseconds(1);
  said_.stamp.run = in_the_way_ ? 0 : run_;
  said_.stamp.tick = tick_;
  said_.participant.state = state_;
  said_.participant.error_norm = error_norm_;
  // What made it stop was first: others may have ended since.
  if (const auto& fault = stopping_ ? stopping_ : failure_; fault) {
    said_.participant.fault_code = static_cast<int>(fault->code());
    said_.participant.fault = std::string(fault->what()).substr(0, loop::max_participant_text);
  }
  return said_;
}

}  // namespace tachless::protocol
