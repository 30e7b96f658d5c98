#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "loop/clock.h"
#include "loop/messages.h"

namespace tachless::protocol {

/// The processes that one process has heard announce themselves, and which of them have proven that
/// they are there now. Announcements carry a counter that rises, and name for each role a process
/// that was heard with the newest of its counters: an announcement that names this process answers
/// its announcement of that counter, so its sender lived after that was sent. A recording answers
/// nothing. Pure; knows neither runs nor what a member does.
class Peers {
 public:
  using Time = loop::Clock::time_point;

  /// Only answers to one of so many last announcements count.
  static constexpr std::int64_t answerable = 16;
  /// Who takes no part is forgotten when it has been silent for so long.
  static constexpr std::chrono::milliseconds forgotten_after{1000};

  struct Peer {
    loop::Participant participant;  ///< of its newest announcement that proved something, if any
    std::int64_t run = 0;
    std::int64_t tick = -1;
    std::string sender;
    std::int64_t counter = 0;  ///< newest
    Time first_heard;
    Time heard;
    std::optional<Time> lived;  ///< the newest moment after which it has proven to have lived
  };

  Peers(loop::Role own_role, std::int64_t own_instance)
      : own_role_(own_role), own_instance_(own_instance) {}

  /// The instance that has the role in this process's run; 0: not known yet. Is not forgotten.
  [[nodiscard]] std::int64_t holder(loop::Role role) const { return holders_[index(role)]; }
  void set_holder(loop::Role role, std::int64_t instance) { holders_[index(role)] = instance; }

  /// Whether it is newer than what its sender has announced before: else it is a copy. What gives a
  /// process another role than it has proven to be there with is somebody else's.
  [[nodiscard]] bool is_new(const loop::Participant& who) const;
  /// When the announcement was sent that `who` answers; nothing if none of the last was.
  [[nodiscard]] std::optional<Time> answered(const loop::Participant& who) const;

  /// @param lived as `answered`: without it nothing that it says is kept but its counter
  /// @return the peer, and whether it was not known, or not proven, before
  struct Remembered {
    Peer& peer;
    bool first = false;
  };
  Remembered remember(const loop::Stamp& stamp, const loop::Participant& who,
                      std::string_view sender, std::optional<Time> lived, Time now);
  /// Unless it is a holder.
  void forget(std::int64_t instance);
  void forget_silent(Time now);
  /// This process was suspended for so long: nobody was silent meanwhile.
  void excuse(std::chrono::nanoseconds suspended);

  /// Gives `mine` the next counter and the names of who was heard. Holders, or who has proven to be
  /// there, are named every other time, each of the others in turn between.
  /// @param holders_only this process is over: it has to be believed once more, by its run's
  /// members
  void sign(loop::Participant& mine, bool holders_only, Time now);

  /// Those that have proven to be there, and the holders among them only where there is one.
  [[nodiscard]] const Peer* find(loop::Role role) const;
  [[nodiscard]] const std::vector<Peer>& all() const { return peers_; }

 private:
  [[nodiscard]] static std::size_t index(loop::Role role) { return static_cast<std::size_t>(role); }
  [[nodiscard]] bool holds(const Peer& peer) const {
    return holder(peer.participant.role) == peer.participant.instance;
  }
  std::vector<Peer>::const_iterator of(std::int64_t instance) const;
  [[nodiscard]] const Peer* to_name(loop::Role role, bool holders_only) const;
  Peer& make_room();

  loop::Role own_role_;
  std::int64_t own_instance_;
  std::int64_t counter_ = 0;             ///< of the last own announcement
  std::array<Time, answerable> sent_{};  ///< when the last were, by counter
  loop::PerRole holders_{};
  std::vector<Peer> peers_;
};

}  // namespace tachless::protocol
