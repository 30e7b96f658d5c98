#include "protocol/peers.h"

#include <algorithm>
#include <tuple>

namespace tachless::protocol {
namespace {

constexpr std::size_t most_peers = 32;  // a flood of announcements must not grow our memory

}  // namespace

std::vector<Peers::Peer>::const_iterator Peers::of(std::int64_t instance) const {
  return std::ranges::find_if(
      peers_, [&](const Peer& each) { return each.participant.instance == instance; });
}

bool Peers::is_new(const loop::Participant& who) const {
  const auto known = of(who.instance);
  if (known == peers_.end()) return true;
  return who.counter > known->counter && (!known->lived || who.role == known->participant.role);
}

std::optional<Peers::Time> Peers::answered(const loop::Participant& who) const {
  const std::int64_t counter = who.heard_counter[index(own_role_)];
  if (who.heard_instance[index(own_role_)] != own_instance_) return std::nullopt;
  if (counter < 1 || counter > counter_ || counter <= counter_ - answerable) return std::nullopt;
  return sent_[static_cast<std::size_t>(counter % answerable)];
}

Peers::Peer& Peers::make_room() {
  if (peers_.size() < most_peers) return peers_.emplace_back();
  // Whoever has proven nothing goes first, then who was heard longest ago; no holder.
  return *std::ranges::min_element(peers_, {}, [&](const Peer& each) {
    return std::tuple(holds(each), each.lived.has_value(), each.heard);
  }) = Peer();
}

Peers::Remembered Peers::remember(const loop::Stamp& stamp, const loop::Participant& who,
                                  std::string_view sender, std::optional<Time> lived, Time now) {
  const auto found = of(who.instance);
  const bool known = found != peers_.end();
  Peer& peer = known ? peers_[static_cast<std::size_t>(found - peers_.begin())] : make_room();
  const bool proves = lived && !peer.lived;
  if (!known) {
    peer.participant = who;
    peer.first_heard = now;
  }
  if (!known || proves) peer.sender = sender;  // whoever repeats a recording has another address
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

void Peers::forget(std::int64_t instance) {
  std::erase_if(peers_, [&](const Peer& each) {
    return each.participant.instance == instance && !holds(each);
  });
}

void Peers::forget_silent(Time now) {
  std::erase_if(peers_, [&](const Peer& each) {
    return now - each.heard >= forgotten_after && !holds(each);
  });
}

void Peers::excuse(std::chrono::nanoseconds suspended) {
  for (Peer& each : peers_) {
    each.heard += suspended;
    if (each.lived) *each.lived += suspended;
  }
  for (Time& each : sent_) each += suspended;
}

void Peers::sign(loop::Participant& mine, bool holders_only, Time now) {
  mine.counter = ++counter_;
  sent_[static_cast<std::size_t>(counter_ % answerable)] = now;
  for (std::size_t role = 0; role < loop::num_roles; ++role) {
    const Peer* named = to_name(static_cast<loop::Role>(role), holders_only);
    mine.heard_instance[role] = named != nullptr ? named->participant.instance : 0;
    mine.heard_counter[role] = named != nullptr ? named->counter : 0;
  }
}

const Peers::Peer* Peers::to_name(loop::Role role, bool holders_only) const {
  const bool held = holder(role) != 0;
  const auto group_of = [&](const Peer& each) {  // 1: preferred
    return static_cast<std::size_t>(held ? holds(each) : each.lived.has_value());
  };
  std::array<std::int64_t, 2> size{};
  for (const Peer& each : peers_) {
    if (each.participant.role == role) ++size[group_of(each)];
  }
  const bool preferred = holders_only || counter_ % 2 == 0 ? size[1] > 0 : size[0] == 0;
  std::int64_t turn = size[preferred] > 0 ? counter_ / 2 % size[preferred] : 0;
  for (const Peer& each : peers_) {
    if (each.participant.role != role || group_of(each) != static_cast<std::size_t>(preferred)) {
      continue;
    }
    if (turn-- == 0) return &each;
  }
  return nullptr;
}

const Peers::Peer* Peers::find(loop::Role role) const {
  const auto found = std::ranges::find_if(peers_, [&](const Peer& each) {
    return each.participant.role == role && each.lived && (holder(role) == 0 || holds(each));
  });
  return found != peers_.end() ? &*found : nullptr;
}

}  // namespace tachless::protocol
