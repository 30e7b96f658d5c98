#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <optional>
#include <string>

#include "bus/authenticated.h"
#include "bus/transport.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "node/statistics.h"
#include "protocol/membership.h"

namespace tachless::node {

/// One process's membership in a run, over a transport: the rendezvous, the heartbeat, the faults
/// of the others, the end. A node calls `meet`, then `attend` in its loop, hands every datagram to
/// `take` first, and ends with `finish`; any Failure that leaves the node is told to the others by
/// `play`.
class Session {
 public:
  struct Config {
    loop::Role role = loop::Role::plant;
    std::optional<std::int64_t> run_id;  ///< plant only; default: microseconds since 1970
    double wait_s = 0;                   ///< for the others at the start; 0 = unlimited
    /// Set when the user wants the process to end.
    const std::atomic<bool>* interrupted = nullptr;
    std::int64_t instance = 0;  ///< tells two processes of one role apart; 0: a random one
    /// The transport once more, if the bus has a key.
    bus::Authenticated* authenticated = nullptr;
    /// Controller only: join a run under way, to succeed a controller that has died.
    bool resume = false;
    /// Controller only: answer the questions of this run, which come from a recording, at once:
    /// nobody is met, nothing is announced, and the run is over with its last tick.
    std::optional<std::int64_t> follow = {};
  };

  /// Subscribes to the participants' channel, unless a recording is followed.
  Session(const experiment::Scenario& scenario, bus::Transport& transport, const Config& config);

  /// Runs `part` (the node's whole life). A Failure that leaves it, or any other exception, is
  /// announced to the others and noted in the statistics before it goes on.
  void play(const std::function<void()>& part);

  /// Waits until the run is known (plant: until all are ready), telling the user who is missing.
  /// `measurement`, `signals`: controller only, channel suffix of what it needs, what it logs.
  /// `other`: is given what comes on the node's own channels meanwhile.
  /// @throw Failure: see `attend`; refused by or refusing another; nobody came within `wait_s`.
  void meet(const std::string& measurement = {}, const std::string& signals = {},
            const std::function<void(const bus::Datagram&)>& other = {});

  [[nodiscard]] std::int64_t run() const {
    return following_ ? *config_.follow : membership_->run();
  }
  /// What the controller needs, seen from the others.
  [[nodiscard]] std::string measurement() const { return membership_->measurement(); }
  [[nodiscard]] std::string signals() const { return membership_->signals(); }

  /// The first message of the run has been sent or accepted.
  void started(loop::Clock::time_point now);

  /// To be called at least when `next_attention` has come: heartbeat, faults, interruption.
  /// @throw Failure(interrupted), Failure(peer_lost, protocol_violated or protective_stop) for
  /// another's fault, saying whose; Failure(peer_lost) when a recording goes silent before its end.
  void attend(loop::Clock::time_point now);
  [[nodiscard]] loop::Clock::time_point next_attention() const {
    return following_ ? following_->look_at : membership_->next_announcement();
  }

  /// Whether the datagram was the session's.
  bool take(const bus::Datagram& datagram);

  /// Whether the message is sound and of this run; counts it if not, and leaves `stamp` and
  /// `value` as they are or (another run's) as they came.
  template <class Value>
  bool accept(const bus::Codec<Value>& codec, const bus::Datagram& datagram, loop::Stamp& stamp,
              Value& value) {
    const bus::Rejection rejection = codec.decode(datagram.payload, stamp, value);
    if (rejection != bus::Rejection::none) {
      statistics_.rejected.add(rejection);
    } else if (stamp.run != run()) {
      statistics_.rejected.add(Discard::other_run);
    } else {
      return true;
    }
    return false;
  }

  /// For the heartbeat.
  void progressed(std::int64_t tick, double error_norm = 0) {
    if (following_) {
      following_->tick = tick;
      following_->progress_at = loop::Clock::now();
    } else {
      membership_->progressed(tick, error_norm);
    }
  }

  [[nodiscard]] bool plant_finished() const {
    return following_ ? following_->tick >= following_->last_tick : membership_->plant_finished();
  }

  /// This process will end with `failure`, and tells the others at once, but has to bring the robot
  /// to rest before it does.
  void stopping(const diagnostics::Failure& failure, loop::Clock::time_point now);
  /// The heartbeat alone, if it is due: for a process that is ending.
  void keep_in_touch(loop::Clock::time_point now) {
    if (now >= next_attention()) announce(now);
  }

  /// Parts from the others: the plant waits until they have finished (at most a second).
  void finish();

  /// How often another controller has taken the place of one that died.
  [[nodiscard]] int takeovers() const { return membership_->takeovers(); }
  /// Newest tick that the role's holder has announced; -1 before.
  [[nodiscard]] std::int64_t tick_of(loop::Role role) const { return membership_->tick_of(role); }

  /// Hears what the others say, and attends: for a process that works for long on its own. Messages
  /// on other channels are lost.
  void stay_in_touch();

  /// Which of these roles cannot be heard any more, in words; all of them, if each can be.
  [[nodiscard]] std::string silent_among(std::initializer_list<loop::Role> roles) const;
  [[nodiscard]] std::string describe(loop::Role role) const { return membership_->describe(role); }
  /// Whether that is where the holder of the role sends from.
  [[nodiscard]] bool is_from(loop::Role role, std::string_view sender) const {
    return membership_->is_from(role, sender);
  }

  /// Whether some other process of this scenario sends from there.
  [[nodiscard]] bool knows(std::string_view sender) const { return membership_->knows(sender); }

  Statistics& statistics() { return statistics_; }
  [[nodiscard]] const Statistics& statistics() const { return statistics_; }

 private:
  /// Where a recorded run is.
  struct Following {
    std::int64_t last_tick = 0;
    std::int64_t tick = -1;  ///< newest one that was answered
    loop::Clock::time_point progress_at;
    loop::Clock::time_point look_at;  ///< when to look at the clock again
  };

  void attend_recording(loop::Clock::time_point now);
  void listen_for_predecessor();
  void announce(loop::Clock::time_point now);
  void announce_fault(const diagnostics::Failure& failure);
  void listen_until(loop::Clock::time_point deadline);
  void note_stranger(bus::Foreign kind, const loop::Participant& who, std::string_view sender);
  void refuse_strangers(loop::Clock::time_point now) const;
  void tell_who_is_missing(loop::Clock::time_point now);

  bus::Transport& transport_;
  Config config_;
  std::string channel_;
  protocol::Membership::Self self_;
  std::optional<protocol::Membership> membership_;
  std::optional<Following> following_;
  bus::Codec<loop::Participant> codec_;
  loop::Stamp heard_stamp_;
  loop::Participant heard_;
  bool entered_ = false;  ///< the session's key is known
  bool anybody_ = false;  ///< has been heard whose key, or lack of one, is ours
  std::string stranger_;  ///< who has another, in words; empty: nobody
  int strangers_heard_ = 0;
  loop::Clock::time_point stranger_since_;
  loop::Clock::time_point started_at_;
  loop::Clock::time_point next_notice_;
  Statistics statistics_;
};

}  // namespace tachless::node
