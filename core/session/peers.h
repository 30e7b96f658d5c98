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

/// The processes whose announcements one process has received, with their proofs of being alive.
/// Announcements carry an increasing counter. For each role they name a process and its newest
/// counter. An announcement that names this process answers its announcement with that counter. The
/// sender was therefore alive after that announcement. A recording cannot contain an answer.
///
/// On a bus without a key a program may leave counters out (0) of all its announcements. Each of
/// these announcements then counts as proof. The class is pure; it knows neither runs nor the
/// reactions of a member.
class Peers {
 public:
  using Time = base::Clock::time_point;

  /// Number of own last announcements whose answers count.
  static constexpr std::int64_t answerable = 16;
  /// Processes that are no holders are dropped after this time without a message.
  static constexpr std::chrono::milliseconds forgotten_after{1000};

  struct Peer {
    /// Content of the newest announcement that proved the process alive; without one, of its first
    /// announcement.
    messages::Participant participant;
    std::int64_t run = 0;
    std::int64_t tick = -1;  ///< newest tick that it has handled
    std::string sender;
    std::int64_t counter = 0;  ///< newest counter
    Time first_heard{};
    Time heard{};
    std::optional<Time> lived{};  ///< newest time after which it has proven to be alive
  };

  /// @param counters_required announcements without a counter are not believed
  Peers(messages::Role own_role, std::int64_t own_instance, bool counters_required)
      : own_role_(own_role), own_instance_(own_instance), counters_required_(counters_required) {}

  /// Returns the instance that has the role in this process's run; 0 if it is not yet known. A
  /// holder is not forgotten.
  [[nodiscard]] std::int64_t holder(messages::Role role) const { return holders_[index(role)]; }
  void set_holder(messages::Role role, std::int64_t instance) { holders_[index(role)] = instance; }

  /// Returns whether an announcement is newer than all earlier ones of its sender; otherwise it is
  /// a copy. A process keeps its role once it has proven to be alive. A process either always or
  /// never uses counters. An announcement that breaks one of these rules comes from another
  /// process.
  [[nodiscard]] bool is_new(const messages::Participant& who) const;
  /// Returns the time at which this process sent the announcement that `who` answers. Returns
  /// nullopt if `who` answers none of the last ones. Returns `now` for an announcement without a
  /// counter if such announcements are believed.
  [[nodiscard]] std::optional<Time> answered(const messages::Participant& who, Time now) const;

  struct Remembered {
    Peer& peer;
    bool first = false;
  };
  /// Remembers the sender of an announcement.
  /// @param lived result of `answered`; nothing: if the process is known, only the announcement's
  /// counter is kept
  /// @return the peer, and whether it was unknown or unproven before
  Remembered remember(const messages::Stamp& stamp, const messages::Participant& who,
                      std::string_view sender, std::optional<Time> lived, Time now);
  /// Forgets the process unless it is a holder.
  void forget(std::int64_t instance);
  void forget_silent(Time now);
  /// Subtracts the time for which this process was suspended from the silence of others.
  void excuse(std::chrono::nanoseconds suspended);

  /// Sets the next counter and one acknowledged process of each role. In every second announcement
  /// this is a holder, or a process that has proven to be alive. In the other announcements the
  /// remaining processes take turns.
  /// @param holders_only this process is ending, so only the run's members still have to believe it
  void fill_acknowledgements(messages::Participant& mine, bool holders_only, Time now);

  /// Returns the role's holder, or without a holder a process of the role that has proven to be
  /// alive.
  [[nodiscard]] const Peer* find(messages::Role role) const;
  [[nodiscard]] const std::vector<Peer>& all() const { return peers_; }

 private:
  static constexpr std::size_t most = 32;  // bounds the memory that a flood of announcements takes

  static std::int64_t instance_of(const Peer& peer) { return peer.participant.instance; }
  [[nodiscard]] bool holds(const Peer& peer) const;

  Peer& make_room();

  [[nodiscard]] const Peer* to_acknowledge(messages::Role role, bool holders_only) const;

  messages::Role own_role_;
  std::int64_t own_instance_;
  bool counters_required_;
  std::int64_t counter_ = 0;             ///< counter of the last own announcement
  std::array<Time, answerable> sent_{};  ///< times of the last own announcements
  messages::PerRole holders_{};
  std::vector<Peer> peers_;
};

/// Returns e.g. "the controller (process 123 on host arm-1, 10.0.0.2:4123)".
std::string describe(const messages::Participant& who, std::string_view sender);
std::string describe(const Peers::Peer& peer);

}  // namespace tachless::session
