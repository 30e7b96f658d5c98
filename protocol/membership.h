#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnostics/failure.h"
#include "loop/clock.h"
#include "loop/messages.h"

namespace tachless::protocol {

/// How the four processes find each other, agree on a run, stay in touch and part again: one
/// process's view. Pure: what is heard goes in, what to announce comes out, time is a value.
///
/// The plant chooses the run; the others adopt it from the plant's announcement when the digests
/// of their scenarios agree, and are then ready; the plant has met the others when each role is
/// held by exactly one process that is ready. Of two processes with one role the newcomer gives
/// way (exit code 4); started at the same time, the one with the larger instance.
///
/// In lockstep a controller that has died may have a successor: a process that `resumes` adopts a
/// run under way, and takes the place of the controller that has not been heard for
/// `succession_after`.
class Membership {
 public:
  using Time = loop::Clock::time_point;

  static constexpr std::chrono::milliseconds period{100};  ///< between announcements
  static constexpr std::chrono::milliseconds forgotten_after{1000};
  /// Processes started within this of each other count as started at the same time.
  static constexpr std::chrono::milliseconds simultaneous{300};
  /// A controller silent for so long may be succeeded: five heartbeats.
  static constexpr std::chrono::milliseconds succession_after{500};

  struct Self {
    loop::Role role = loop::Role::plant;
    std::int64_t instance = 0;
    std::int64_t digest = 0;
    std::int32_t pid = 0;
    std::string host;
    std::string scenario;     ///< its name
    std::string measurement;  ///< controller only: channel suffix of what it needs
    std::string signals;      ///< controller only: what its law logs
    std::int64_t run = 0;     ///< plant only: the run it has chosen, > 0
    /// The run has to begin before this; default: no limit.
    std::optional<std::chrono::nanoseconds> wait_limit;
    std::chrono::nanoseconds give_up = std::chrono::seconds(5);  ///< a peer silent so long is lost
    bool succession = false;  ///< the mode allows it: a lockstep run waits for the successor
    bool resumes = false;     ///< controller only: joins a run under way, to succeed another
  };

  struct Announcement {
    loop::Stamp stamp;
    loop::Participant participant;
  };

  /// @throw std::logic_error when a plant has no run or another role has one.
  Membership(const Self& self, Time now);

  void hear(const loop::Stamp& stamp, const loop::Participant& peer, std::string_view sender,
            Time now);

  /// Looks at the clock: peers that have fallen silent, the limit of waiting. To be called every
  /// period; time in which this process itself was kept from it is nobody's silence.
  void check(Time now);

  /// Why this process has to end, if it has to.
  [[nodiscard]] const std::optional<diagnostics::Failure>& failure() const { return failure_; }

  /// Plant: the run may start. Others: the plant's run is known, its questions may come.
  [[nodiscard]] bool met() const { return met_; }
  [[nodiscard]] std::int64_t run() const { return run_; }
  /// The instance of the plant that was met, or of this one; 0 before.
  [[nodiscard]] std::int64_t plant_instance() const;

  /// The run has begun: announced, and from now on newcomers are ignored. Nothing new if it has
  /// begun, or ended, before.
  void started(Time now);
  [[nodiscard]] bool running() const { return state_ == loop::ParticipantState::running; }
  /// Newest tick handled, and (controller) the norm of its position error, for the heartbeat.
  void progressed(std::int64_t tick, double error_norm);
  /// This process has done its part.
  void finished(Time now);
  /// This process ends with a fault, for all to know.
  void failed(const diagnostics::Failure& failure, Time now);
  /// This process is about to end with a fault, and says so already, but still has to bring the
  /// robot to rest: announced beside the state it is in, which ends nobody's part.
  void stopping(const diagnostics::Failure& failure, Time now);

  /// How often another process has taken a role's place in this run, as far as heard.
  [[nodiscard]] int successions() const { return successions_; }
  /// Newest tick that the role's holder has announced; -1 before.
  [[nodiscard]] std::int64_t tick_of(loop::Role role) const;

  /// The plant that was met has announced that the run is finished.
  [[nodiscard]] bool plant_finished() const { return plant_finished_; }
  /// The three others have.
  [[nodiscard]] bool all_finished() const;

  /// Roles of which nobody has been heard.
  [[nodiscard]] std::vector<loop::Role> missing() const;
  /// What the controller needs; empty before it is heard.
  [[nodiscard]] std::string measurement() const;
  [[nodiscard]] std::string signals() const;

  /// "the controller (process 123 on host arm-1, 10.0.0.2:4123)"; "the controller" if unknown.
  [[nodiscard]] std::string describe(loop::Role role) const;
  /// Whether that is where the holder of the role sends from.
  [[nodiscard]] bool is_from(loop::Role role, std::string_view sender) const;
  /// Whether some other process of this scenario sends from there.
  [[nodiscard]] bool knows(std::string_view sender) const;
  /// How long ago the role's holder was heard; nothing if never.
  [[nodiscard]] std::optional<std::chrono::nanoseconds> silence(loop::Role role, Time now) const;

  [[nodiscard]] Time next_announcement() const { return announce_at_; }
  /// What to publish now; the next one is due a period later. Valid until the next call; allocates
  /// nothing while all is well.
  const Announcement& announce(Time now);

 private:
  struct Peer {
    loop::Participant participant;
    std::int64_t run = 0;
    std::int64_t tick = -1;
    std::string sender;
    Time first_heard;
    Time heard;
  };

  [[nodiscard]] bool over() const;
  [[nodiscard]] bool in_our_run(const loop::Stamp& stamp, const loop::Participant& peer) const;
  Peer& note(const loop::Stamp& stamp, const loop::Participant& peer, std::string_view sender,
             Time now);
  [[nodiscard]] bool would_succeed(const loop::Stamp& stamp, const loop::Participant& peer) const;
  [[nodiscard]] bool succeeds(const loop::Stamp& stamp, const loop::Participant& peer,
                              Time now) const;
  void contest(const loop::Stamp& stamp, const Peer& other, Time now);
  void refuse(const Peer& other, Time now);
  void adopt(const loop::Stamp& stamp, const loop::Participant& plant, Time now);
  void look_for_all(Time now);
  [[nodiscard]] const Peer* holder(loop::Role role) const;
  [[nodiscard]] static std::string describe(const Peer& peer);
  /// Why this process ends when that one has announced a fault.
  [[nodiscard]] static diagnostics::Failure because_of(const Peer& failed);
  void fail(const diagnostics::Failure& failure, Time now);

  Self self_;
  Time start_;
  Time announce_at_;
  Time checked_;
  loop::ParticipantState state_ = loop::ParticipantState::waiting;
  std::int64_t run_ = 0;
  bool met_ = false;
  bool in_the_way_ = false;  ///< the fault is ours alone: no part of any run
  bool plant_finished_ = false;
  int successions_ = 0;
  std::int64_t tick_ = -1;
  double error_norm_ = 0;
  std::vector<Peer> peers_;
  Announcement said_;
  /// Who plays each role in this run; 0: not known yet.
  std::array<std::int64_t, loop::num_roles> cast_{};
  std::array<bool, loop::num_roles> done_{};
  std::optional<diagnostics::Failure> failure_;
  std::optional<diagnostics::Failure> stopping_;
  /// A successor that could not resume. It may say so before its predecessor has been silent for
  /// long enough, and says it once.
  std::optional<diagnostics::Failure> failed_successor_;
};

}  // namespace tachless::protocol
