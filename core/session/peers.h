#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/clock.h"
#include "messages/messages.h"

namespace tachless::session {

/// Returns the index of the role in a messages::PerRole.
constexpr std::size_t index(messages::Role role) { return static_cast<std::size_t>(role); }

/// The processes whose announcements one process has received, and which of them have proven that
/// they are there now. Announcements carry a counter that rises, and name for each role a process
/// with the newest of its counters: an announcement that names this process answers its
/// announcement of that counter, so its sender lived after that was sent. A recording answers
/// nothing. On a bus without a key a program may leave counters out (0) in all that it announces:
/// then every announcement is proof. Pure; knows neither runs nor what a member does.
class Peers {
 public:
  using Time = base::Clock::time_point;

  /// Only answers to one of so many last announcements count.
  static constexpr std::int64_t answerable = 16;
  /// Processes that are no holders are dropped after this long without a message.
  static constexpr std::chrono::milliseconds forgotten_after{1000};

  struct Peer {
    messages::Participant
        participant;  ///< of its newest announcement that proved something, if any
    std::int64_t run = 0;
    std::int64_t tick = -1;  ///< newest that it has handled
    std::string sender;
    std::int64_t counter = 0;  ///< newest
    Time first_heard{};
    Time heard{};
    std::optional<Time> lived{};  ///< the newest moment after which it has proven to have lived
  };

  /// @param counters_required an announcement without a counter is not believed
  Peers(messages::Role own_role, std::int64_t own_instance, bool counters_required)
      : own_role_(own_role), own_instance_(own_instance), counters_required_(counters_required) {}

  /// Returns the instance that has the role in this process's run; 0: not known yet. A holder is
  /// not forgotten.
  [[nodiscard]] std::int64_t holder(messages::Role role) const { return holders_[index(role)]; }
  void set_holder(messages::Role role, std::int64_t instance) { holders_[index(role)] = instance; }

  /// Returns whether an announcement is newer than all of its sender's before; if not, it is a
  /// copy. A process keeps the role with which it has proven to be there, and keeps counting or not
  /// counting. An announcement that changes either was sent by another process.
  [[nodiscard]] bool is_new(const messages::Participant& who) const;
  /// Returns when this process sent the announcement that `who` answers; nothing if `who` answers
  /// none of the last ones. Returns now for an announcement without a counter, where such
  /// announcements are believed.
  [[nodiscard]] std::optional<Time> answered(const messages::Participant& who, Time now) const;

  struct Remembered {
    Peer& peer;
    bool first = false;
  };
  /// @param lived as `answered`: without it nothing that it says is kept but its counter
  /// @return the peer, and whether it was not known, or not proven, before
  Remembered remember(const messages::Stamp& stamp, const messages::Participant& who,
                      std::string_view sender, std::optional<Time> lived, Time now);
  /// Forgets the process, unless it is a holder.
  void forget(std::int64_t instance);
  void forget_silent(Time now);
  /// Does not count the time for which this process was suspended as the silence of others.
  void excuse(std::chrono::nanoseconds suspended);

  /// Sets the next counter and, per role, the process being acknowledged: holders, or those that
  /// have proven to be there, every other time, each of the others in turn between.
  /// @param holders_only this process is over: only the run's members still have to believe it
  void fill_acknowledgements(messages::Participant& mine, bool holders_only, Time now);

  /// Returns the process of a role that has proven to be there: the role's holder, if there is one.
  [[nodiscard]] const Peer* find(messages::Role role) const;
  [[nodiscard]] const std::vector<Peer>& all() const { return peers_; }

 private:
  static constexpr std::size_t most = 32;  // a flood of announcements must not grow our memory

  static std::int64_t instance_of(const Peer& peer) { return peer.participant.instance; }
  [[nodiscard]] bool holds(const Peer& peer) const;

  Peer& make_room();

  [[nodiscard]] const Peer* to_acknowledge(messages::Role role, bool holders_only) const;

  messages::Role own_role_;
  std::int64_t own_instance_;
  bool counters_required_;
  std::int64_t counter_ = 0;             ///< of the last own announcement
  std::array<Time, answerable> sent_{};  ///< when the last were, by counter
  messages::PerRole holders_{};
  std::vector<Peer> peers_;
};

/// "the controller (process 123 on host arm-1, 10.0.0.2:4123)"
std::string describe(const messages::Participant& who, std::string_view sender);
std::string describe(const Peers::Peer& peer);

}  // namespace tachless::session
