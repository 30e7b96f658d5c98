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

/// Which four processes take part in a run, seen from one of them: how they find each other, agree
/// on the run, notice each other's faults and silence, and end. Pure: announcements received go in,
/// the announcement to publish comes out, time is a value. Sends and receives nothing and knows no
/// tick protocol; what happens at which event is membership_table.h.
///
/// Only what answers one of the last announcements of this process is believed
/// (core/session/peers.h): a recording has no effect but that its sender is named, and may answer.
/// On a bus without a key a process that uses no counters is believed as it comes.
///
/// The plant chooses the run; the others adopt it from the plant's announcement when the digests
/// of their scenarios agree, and are then ready. When each other role has exactly one process that
/// is ready, the plant announces the roster of the four; a member that finds itself in it, and
/// knows the others, confirms it by announcing it too, and has joined. The plant has joined when
/// all three have confirmed; if one of them ends before that, it chooses anew. Of two processes
/// with one role the later one fails (exit code 4); of two started at the same time, the one with
/// the larger instance; a process in the roster never yields to one that is not.
class Membership {
 public:
  using Time = base::Clock::time_point;
  using Peer = Peers::Peer;

  static constexpr std::chrono::milliseconds period{100};  ///< between announcements
  static constexpr std::chrono::milliseconds forgotten_after = Peers::forgotten_after;
  /// Processes started within this of each other count as started at the same time.
  static constexpr std::chrono::milliseconds simultaneous{300};

  struct Self {
    /// Its announcement of itself: role, instance, scenario_digest, pid, host, scenario and, of a
    /// controller, its law.
    messages::Participant who;
    std::int64_t run = 0;  ///< plant only: the run it has chosen, > 0
    /// The run has to begin before this; default: no limit.
    std::optional<std::chrono::nanoseconds> wait_limit;
    std::chrono::nanoseconds give_up = std::chrono::seconds(5);  ///< a peer silent so long is lost
    bool counters_required = true;                               ///< false on a bus without a key
  };

  struct Announcement {
    messages::Stamp stamp;
    messages::Participant participant;
  };

  /// @throw std::logic_error when a plant has no run or another role has one.
  Membership(const Self& self, Time now);

  /// Another process's announcement.
  /// @return whether it is a member's own: newer than what that member announced before, an answer
  /// to one of the last announcements of this process, and from the holder of a role. Nothing else
  /// may be recorded.
  bool handle(const messages::Stamp& stamp, const messages::Participant& peer,
              std::string_view sender, Time now);

  /// Checks for peers that have fallen silent and for the end of the wait. To be called every
  /// period; if this process was suspended, that time is not counted as silence.
  void poll(Time now);

  /// Why this process has to end, if it has to.
  [[nodiscard]] const std::optional<base::Failure>& failure() const { return failure_; }

  /// The roster is known, and (plant) confirmed by all: the run may start.
  [[nodiscard]] bool has_joined() const { return joined_; }
  [[nodiscard]] std::int64_t run() const { return run_; }
  /// The instances of the four that the run began with; zeros before joining.
  [[nodiscard]] const messages::PerRole& roster() const { return roster_; }

  /// The first message of the run has been sent or accepted. No effect when running already.
  /// @throw std::logic_error before joining.
  void on_started(Time now) { act(MembershipEvent::run_started, now); }
  [[nodiscard]] bool is_running() const { return state_ == messages::ParticipantState::running; }
  /// Newest tick handled, and (controller) the norm of its position error, for the announcement.
  void on_progress(std::int64_t tick, double error_norm) {
    tick_ = tick;
    error_norm_ = error_norm;
  }
  /// Takes note that all ticks of this process are there. Only from now on the ends of others
  /// count.
  void on_all_ticks_done() { complete_ = true; }
  /// Lockstep plant: digest of every TRUTH of the run, for the others to compare.
  void set_truth_digest(std::int64_t truth_digest) {
    announcement_.participant.truth_digest = truth_digest;
  }
  /// The plant's digest of them, announced when it has finished; 0 before.
  [[nodiscard]] std::int64_t truth_digest() const {
    const Peer* plant = peers_.find(messages::Role::plant);
    return plant != nullptr ? plant->participant.truth_digest : 0;
  }
  /// This process's part is done.
  void on_finished(Time now) { act(MembershipEvent::part_finished, now); }
  /// This process ends with a fault.
  void on_failed(const base::Failure& failure, Time now) {
    act(MembershipEvent::failure, now, failure);
  }
  /// This process will end with a fault, but has to bring the robot to rest first: the fault is
  /// announced with the present state, which ends nobody else's part yet.
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
  /// The plant has acknowledged an announcement in which this process had finished.
  [[nodiscard]] bool is_finish_acknowledged() const;

  /// Roles of which no process is known.
  [[nodiscard]] std::vector<std::string_view> missing() const;
  /// Returns the law that the controller announces; empty before it is known.
  [[nodiscard]] messages::LawInfo law() const {
    const Peer* peer = peers_.find(messages::Role::controller);
    return peer != nullptr ? messages::LawInfo(peer->participant) : messages::LawInfo();
  }

  /// "the controller (process 123 on host arm-1, 10.0.0.2:4123)"; "the controller" if unknown.
  [[nodiscard]] std::string describe(messages::Role role) const;
  /// Returns whether the holder of the role sends from that address.
  [[nodiscard]] bool is_from(messages::Role role, std::string_view sender) const {
    const Peer* peer = peers_.find(role);
    return peer != nullptr && peer->sender == sender;
  }
  /// Returns whether another process of this scenario sends from that address.
  [[nodiscard]] bool knows(std::string_view sender) const;
  /// Time since the role's holder has proven to have lived; nothing if it never has.
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
  /// The plant watches all holders, the others the plant, until they have finished.
  [[nodiscard]] bool watches(messages::Role role) const {
    const bool own_concern = own_role() == messages::Role::plant || role == messages::Role::plant;
    return own_concern && holder(role) != 0 && !done_[index(role)];
  }
  /// Returns whether the rival has precedence over this process.
  [[nodiscard]] bool precedes(const messages::Stamp& stamp, const Peer& rival, Time now) const;

  void act(MembershipEvent event, Time now, const std::optional<base::Failure>& failure = {});
  /// `outside`: it is announced outside any run.
  void fail(const base::Failure& failure, Time now, bool outside = false);
  void announce_soon(Time now);
  void join(const Peer& peer, Time now);
  void choose_roster(Time now);
  /// Not yet while a process in it is unknown.
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
  bool outside_ = false;  ///< refused or superfluous: its fault is announced outside any run
  bool complete_ = false;
  std::int64_t tick_ = -1;
  double error_norm_ = 0;
  Peers peers_;
  Announcement announcement_;
  messages::PerRole roster_{};
  std::array<bool, messages::num_roles> confirmed_{};  ///< plant: the roles that have confirmed it
  std::array<bool, messages::num_roles> done_{};
  std::int64_t end_counter_ = 0;  ///< of the first own announcement of having finished
  std::optional<base::Failure> failure_;
  std::optional<base::Failure> stopping_;
};

}  // namespace tachless::session
