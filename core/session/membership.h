#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/clock.h"
#include "base/failure.h"
#include "messages/messages.h"
#include "session/membership_table.h"
#include "session/peers.h"

namespace tachless::session {

/// Membership of one process in a run of four. It covers how the processes find each other and
/// agree on the run, notice each other's faults and silence, and end. The class is pure: it takes
/// received announcements and times, and returns the announcement to publish. It sends and receives
/// nothing and knows no tick protocol. membership_table.h holds the reaction to each event.
///
/// A process is believed only if it answers one of this process's last announcements
/// (core/session/peers.h). A recording therefore has one effect only: announcements name its
/// sender, which may answer. On a bus without a key, a process that uses no counters is believed
/// without an answer.
///
/// The plant chooses the run. The others adopt the run from the plant's announcement if the digests
/// of their scenarios agree; they are then ready. When each other role has exactly one ready
/// process, the plant announces the roster of the four. A member that is in the roster and knows
/// the others confirms the roster by announcing it, and has joined. The plant has joined when all
/// three have confirmed. If one of them ends before that, the plant chooses a new roster.
///
/// If two processes have one role, the later one fails (exit code 4). If both started at the same
/// time, the one with the larger instance fails. A process in the roster never yields to a process
/// outside it.
class Membership {
 public:
  using Time = base::Clock::time_point;
  using Peer = Peers::Peer;

  static constexpr std::chrono::milliseconds period{100};  ///< period of the announcements
  static constexpr std::chrono::milliseconds forgotten_after = Peers::forgotten_after;
  /// Processes whose starts differ by at most this count as started at the same time.
  static constexpr std::chrono::milliseconds simultaneous{300};

  struct Self {
    /// This process's announcement of itself: role, instance, scenario_digest, pid, host and
    /// scenario. A controller adds its law.
    messages::Participant who;
    std::int64_t run = 0;  ///< plant only: the run that it has chosen, > 0
    /// Longest time until the run begins; default: no limit.
    std::optional<std::chrono::nanoseconds> wait_limit;
    /// Silence after which a peer is lost.
    std::chrono::nanoseconds give_up = std::chrono::seconds(5);
    bool counters_required = true;  ///< false on a bus without a key
  };

  struct Announcement {
    messages::Stamp stamp;
    messages::Participant participant;
  };

  /// @throw std::logic_error if a plant has no run or another role has one.
  Membership(const Self& self, Time now);

  /// Handles another process's announcement.
  /// @return whether it is a member's own and hence may be recorded. It must be newer than that
  /// member's earlier announcements and answer one of the last announcements of this process. Its
  /// sender must hold a role.
  bool handle(const messages::Stamp& stamp, const messages::Participant& peer,
              std::string_view sender, Time now);

  /// Checks for silent peers and for the end of the wait. Call it every period. Time for which this
  /// process was suspended does not count as silence.
  void poll(Time now);

  /// Returns the reason for which this process has to end, if there is one.
  [[nodiscard]] const std::optional<base::Failure>& failure() const { return failure_; }

  /// Returns whether the run may start: the roster is known and, for the plant, confirmed by all.
  [[nodiscard]] bool has_joined() const { return joined_; }
  [[nodiscard]] std::int64_t run() const { return run_; }
  /// Returns the instances of the four processes of the run; zeros before joining.
  [[nodiscard]] const messages::PerRole& roster() const { return roster_; }

  /// Notes that the first message of the run has been sent or accepted. No effect while the run is
  /// running.
  /// @throw std::logic_error before joining.
  void on_started(Time now) { act(MembershipEvent::run_started, now); }
  [[nodiscard]] bool is_running() const { return state_ == messages::ParticipantState::running; }
  /// Sets the newest handled tick and, for a controller, the norm of its position error [rad], for
  /// the announcement.
  void on_progress(std::int64_t tick, double error_norm) {
    tick_ = tick;
    error_norm_ = error_norm;
  }
  /// Notes that this process has all ticks. The ends of others are believed only from now on.
  void on_all_ticks_done() { complete_ = true; }
  /// Sets a lockstep plant's digest of every TRUTH of the run, which the others compare.
  void set_truth_digest(std::int64_t truth_digest) {
    announcement_.participant.truth_digest = truth_digest;
  }
  /// Returns the plant's digest of every TRUTH, which the plant announces when it has finished; 0
  /// before.
  [[nodiscard]] std::int64_t truth_digest() const {
    const Peer* plant = peers_.find(messages::Role::plant);
    return plant != nullptr ? plant->participant.truth_digest : 0;
  }
  /// Notes that this process has done its part.
  void on_finished(Time now) { act(MembershipEvent::part_finished, now); }
  /// Notes that this process ends with a fault.
  void on_failed(const base::Failure& failure, Time now) {
    act(MembershipEvent::failure, now, failure);
  }
  /// Notes that this process will end with a fault, after it has brought the robot to rest. The
  /// fault is announced with the present state, so that no other process ends yet.
  void on_stopping(const base::Failure& failure, Time now);

  /// Returns whether the run's plant has announced that it has finished.
  [[nodiscard]] bool has_plant_finished() const { return done_[index(messages::Role::plant)]; }
  /// Returns whether the three others have announced that they have finished.
  [[nodiscard]] bool have_all_finished() const {
    return std::ranges::count(done_, true) == messages::num_roles - 1;
  }
  /// Describes the others that have not finished.
  [[nodiscard]] std::string unfinished() const;
  /// Returns whether one of the others has not handled the newest tick of this process.
  [[nodiscard]] bool others_lack_ticks() const;
  /// Returns whether the plant has acknowledged an announcement in which this process had finished.
  [[nodiscard]] bool is_finish_acknowledged() const;

  /// Returns the roles without a known process.
  [[nodiscard]] std::vector<std::string_view> missing() const;
  /// Returns the law that the controller announces; empty before it is known.
  [[nodiscard]] messages::LawInfo law() const {
    const Peer* peer = peers_.find(messages::Role::controller);
    return peer != nullptr ? messages::LawInfo(peer->participant) : messages::LawInfo();
  }

  /// Returns e.g. "the controller (process 123 on host arm-1, 10.0.0.2:4123)"; "the controller" if
  /// unknown.
  [[nodiscard]] std::string describe(messages::Role role) const;
  /// Returns whether the holder of the role sends from that address.
  [[nodiscard]] bool is_from(messages::Role role, std::string_view sender) const {
    const Peer* peer = peers_.find(role);
    return peer != nullptr && peer->sender == sender;
  }
  /// Returns whether another process of this scenario sends from that address.
  [[nodiscard]] bool knows(std::string_view sender) const;
  /// Returns the time since the role's holder has last proven to be alive; nullopt if it never has.
  [[nodiscard]] std::optional<std::chrono::nanoseconds> silence(messages::Role role,
                                                                Time now) const {
    const Peer* peer = peers_.find(role);
    return peer != nullptr ? std::optional(now - *peer->lived) : std::nullopt;
  }

  [[nodiscard]] Time next_announcement() const { return announce_at_; }
  /// Returns the announcement to publish now. It is valid until the next call; the call allocates
  /// nothing while there is no fault.
  const Announcement& announce(Time now);

 private:
  [[nodiscard]] MembershipEvent event_of(const messages::Stamp& stamp,
                                         const messages::Participant& peer) const;
  void react(MembershipReaction what, const messages::Stamp& stamp,
             const messages::Participant& peer, std::string_view sender, std::optional<Time> lived,
             Time now);
  [[nodiscard]] bool in_own_run(const messages::Stamp& stamp,
                                const messages::Participant& peer) const;
  [[nodiscard]] MembershipEvent event_of_roster(const messages::Participant& peer) const;
  [[nodiscard]] messages::Role own_role() const { return self_.who.role; }
  [[nodiscard]] std::int64_t holder(messages::Role role) const { return peers_.holder(role); }
  [[nodiscard]] bool roster_known() const { return roster_ != messages::PerRole{}; }
  /// Returns whether this process watches the role. The plant watches all holders until they have
  /// finished; the others watch the plant.
  [[nodiscard]] bool watches(messages::Role role) const {
    const bool own_concern = own_role() == messages::Role::plant || role == messages::Role::plant;
    return own_concern && holder(role) != 0 && !done_[index(role)];
  }
  /// Returns whether the rival has precedence over this process.
  [[nodiscard]] bool precedes(const messages::Stamp& stamp, const Peer& rival, Time now) const;

  void act(MembershipEvent event, Time now, const std::optional<base::Failure>& failure = {});
  /// @param outside the fault is announced outside any run
  void fail(const base::Failure& failure, Time now, bool outside = false);
  void announce_soon(Time now);
  void join(const Peer& peer, Time now);
  void choose_roster(Time now);
  /// Takes the plant's roster, unless a process in the roster is still unknown.
  void take_roster(const messages::PerRole& roster, Time now);
  void dissolve(Time now);
  void enter(messages::ParticipantState state, Time now);

  Self self_;
  Time start_;
  Time announce_at_;
  Time announced_;
  Time polled_;
  messages::ParticipantState state_ = messages::ParticipantState::waiting;
  std::int64_t run_ = 0;
  bool joined_ = false;
  /// Refused or superfluous process: its fault is announced outside any run.
  bool outside_ = false;
  bool complete_ = false;
  std::int64_t tick_ = -1;
  double error_norm_ = 0;
  Peers peers_;
  Announcement announcement_;
  messages::PerRole roster_{};
  /// Plant: the roles that have confirmed the roster.
  std::array<bool, messages::num_roles> confirmed_{};
  std::array<bool, messages::num_roles> done_{};
  std::int64_t end_counter_ = 0;  ///< counter of the first own announcement of having finished
  std::optional<base::Failure> failure_;
  std::optional<base::Failure> stopping_;
};

}  // namespace tachless::session
