#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "base/clock.h"
#include "messages/messages.h"

namespace tachless::session {

/// Of the role in a messages::PerRole.
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

  /// @param counters_required what has no counter is not believed
  Peers(messages::Role own_role, std::int64_t own_instance, bool counters_required)
      : own_role_(own_role), own_instance_(own_instance), counters_required_(counters_required) {}

  /// The instance that has the role in this process's run; 0: not known yet. Is not forgotten.
  [[nodiscard]] std::int64_t holder(messages::Role role) const { return holders_[index(role)]; }
  void set_holder(messages::Role role, std::int64_t instance) { holders_[index(role)] = instance; }

  /// Whether it is newer than what its sender has announced before: else it is a copy. A process
  /// keeps the role with which it has proven to be there, and counts or does not: another process
  /// sent what changes it.
  [[nodiscard]] bool is_new(const messages::Participant& who) const {
    const auto known = std::ranges::find(peers_, who.instance, instance_of);
    if (known == peers_.end()) return true;
    if (known->lived && who.role != known->participant.role) return false;
    return who.counter > known->counter ? known->counter > 0 || !known->lived
                                        : who.counter == 0 && known->counter == 0;
  }
  /// When the announcement was sent that `who` answers; nothing if none of the last was. Now for
  /// one without a counter, where that is believed.
  [[nodiscard]] std::optional<Time> answered(const messages::Participant& who, Time now) const {
    if (!counters_required_ && who.counter == 0) return now;
    const std::int64_t counter = who.heard_counter[index(own_role_)];
    if (who.heard_instance[index(own_role_)] != own_instance_) return std::nullopt;
    if (counter < 1 || counter > counter_ || counter <= counter_ - answerable) return std::nullopt;
    return sent_[static_cast<std::size_t>(counter % answerable)];
  }

  struct Remembered {
    Peer& peer;
    bool first = false;
  };
  /// @param lived as `answered`: without it nothing that it says is kept but its counter
  /// @return the peer, and whether it was not known, or not proven, before
  Remembered remember(const messages::Stamp& stamp, const messages::Participant& who,
                      std::string_view sender, std::optional<Time> lived, Time now) {
    const auto found = std::ranges::find(peers_, who.instance, instance_of);
    const bool known = found != peers_.end();
    Peer& peer = known ? *found : make_room();
    const bool proves = lived && !peer.lived;
    if (!known) {
      peer.participant = who;
      peer.first_heard = now;
    }
    if (!known || proves) peer.sender = sender;  // a recording comes from another address
    peer.counter = who.counter;
    peer.heard = now;
    if (lived) {
      peer.participant = who;
      peer.run = stamp.run;
      peer.tick = stamp.tick;
      peer.lived = std::max(peer.lived.value_or(*lived), *lived);
    }
    return {peer, !known || proves};
  }
  /// Unless it is a holder.
  void forget(std::int64_t instance) {
    std::erase_if(peers_, [&](const Peer& each) {
      return each.participant.instance == instance && !holds(each);
    });
  }
  void forget_silent(Time now) {
    std::erase_if(peers_, [&](const Peer& each) {
      return now - each.heard >= forgotten_after && !holds(each);
    });
  }
  /// This process was suspended for so long: that counts as no other's silence.
  void excuse(std::chrono::nanoseconds suspended) {
    for (Peer& each : peers_) {
      each.heard += suspended;
      if (each.lived) *each.lived += suspended;
    }
    for (Time& each : sent_) each += suspended;
  }

  /// Sets the next counter and, per role, the process being acknowledged: holders, or those that
  /// have proven to be there, every other time, each of the others in turn between.
  /// @param holders_only this process is over: only the run's members still have to believe it
  void fill_acknowledgements(messages::Participant& mine, bool holders_only, Time now) {
    mine.counter = ++counter_;
    sent_[static_cast<std::size_t>(counter_ % answerable)] = now;
    for (std::size_t role = 0; role < messages::num_roles; ++role) {
      const Peer* named = to_acknowledge(static_cast<messages::Role>(role), holders_only);
      mine.heard_instance[role] = named != nullptr ? named->participant.instance : 0;
      mine.heard_counter[role] = named != nullptr ? named->counter : 0;
    }
  }

  /// Those that have proven to be there, and the holders among them only where there is one.
  [[nodiscard]] const Peer* find(messages::Role role) const {
    const auto found = std::ranges::find_if(peers_, [&](const Peer& each) {
      return each.participant.role == role && each.lived && (holder(role) == 0 || holds(each));
    });
    return found != peers_.end() ? &*found : nullptr;
  }
  [[nodiscard]] const std::vector<Peer>& all() const { return peers_; }

 private:
  static constexpr std::size_t most = 32;  // a flood of announcements must not grow our memory

  static std::int64_t instance_of(const Peer& peer) { return peer.participant.instance; }
  [[nodiscard]] bool holds(const Peer& peer) const {
    return holder(peer.participant.role) == peer.participant.instance;
  }

  Peer& make_room() {
    if (peers_.size() < most) return peers_.emplace_back();
    // First those that have proven nothing, then the one silent for longest; no holder.
    return *std::ranges::min_element(peers_, {}, [&](const Peer& each) {
      return std::tuple(holds(each), each.lived.has_value(), each.heard);
    }) = Peer();
  }

  [[nodiscard]] const Peer* to_acknowledge(messages::Role role, bool holders_only) const {
    const bool held = holder(role) != 0;
    const auto group_of = [&](const Peer& each) {  // 1: preferred
      return static_cast<std::size_t>(held ? holds(each) : each.lived.has_value());
    };
    std::array<std::int64_t, 2> size{};
    for (const Peer& each : peers_) {
      if (each.participant.role == role) ++size[group_of(each)];
    }
    const std::size_t preferred = holders_only || counter_ % 2 == 0 ? size[1] > 0 : size[0] == 0;
    std::int64_t turn = size[preferred] > 0 ? counter_ / 2 % size[preferred] : 0;
    for (const Peer& each : peers_) {
      if (each.participant.role == role && group_of(each) == preferred && turn-- == 0) return &each;
    }
    return nullptr;
  }

  messages::Role own_role_;
  std::int64_t own_instance_;
  bool counters_required_;
  std::int64_t counter_ = 0;             ///< of the last own announcement
  std::array<Time, answerable> sent_{};  ///< when the last were, by counter
  messages::PerRole holders_{};
  std::vector<Peer> peers_;
};

/// "the controller (process 123 on host arm-1, 10.0.0.2:4123)"
inline std::string describe(const messages::Participant& who, std::string_view sender) {
  return fmt::format("the {} (process {}{}{}{}{})", messages::name(who.role), who.pid,
                     who.host.empty() ? "" : " on ", who.host, sender.empty() ? "" : ", ", sender);
}
inline std::string describe(const Peers::Peer& peer) {
  return describe(peer.participant, peer.sender);
}

}  // namespace tachless::session
