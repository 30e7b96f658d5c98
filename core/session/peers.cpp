#include "session/peers.h"

#include <fmt/core.h>

#include <algorithm>
#include <tuple>

namespace tachless::session {

bool Peers::is_new(const messages::Participant& who) const {
  const auto known = std::ranges::find(peers_, who.instance, instance_of);
  if (known == peers_.end()) return true;
  if (known->lived && who.role != known->participant.role) return false;
  // A process that has proven to be alive keeps counting, or keeps not counting.
  const bool counts_on = who.counter > known->counter && (known->counter > 0 || !known->lived);
  const bool never_counts = who.counter == 0 && known->counter == 0;
  return counts_on || never_counts;
}

std::optional<Peers::Time> Peers::answered(const messages::Participant& who, Time now) const {
  if (!counters_required_ && who.counter == 0) return now;
  const std::int64_t counter = who.heard_counter[index(own_role_)];
  if (who.heard_instance[index(own_role_)] != own_instance_) return std::nullopt;
  if (counter < 1 || counter > counter_ || counter <= counter_ - answerable) return std::nullopt;
  return sent_[static_cast<std::size_t>(counter % answerable)];
}

Peers::Remembered Peers::remember(const messages::Stamp& stamp, const messages::Participant& who,
                                  std::string_view sender, std::optional<Time> lived, Time now) {
  const auto found = std::ranges::find(peers_, who.instance, instance_of);
  const bool known = found != peers_.end();
  Peer& peer = known ? *found : make_room();
  const bool proves = lived && !peer.lived;
  if (!known) {
    peer.participant = who;
    peer.first_heard = now;
  }
  if (!known || proves) peer.sender = sender;  // the sender of a recording has another address
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

void Peers::fill_acknowledgements(messages::Participant& mine, bool holders_only, Time now) {
  mine.counter = ++counter_;
  sent_[static_cast<std::size_t>(counter_ % answerable)] = now;
  for (std::size_t role = 0; role < messages::num_roles; ++role) {
    const Peer* named = to_acknowledge(static_cast<messages::Role>(role), holders_only);
    mine.heard_instance[role] = named != nullptr ? named->participant.instance : 0;
    mine.heard_counter[role] = named != nullptr ? named->counter : 0;
  }
}

const Peers::Peer* Peers::find(messages::Role role) const {
  const auto found = std::ranges::find_if(peers_, [&](const Peer& each) {
    return each.participant.role == role && each.lived && (holder(role) == 0 || holds(each));
  });
  return found != peers_.end() ? &*found : nullptr;
}

bool Peers::holds(const Peer& peer) const {
  return holder(peer.participant.role) == peer.participant.instance;
}

Peers::Peer& Peers::make_room() {
  if (peers_.size() < most) return peers_.emplace_back();
  // Processes without proof are replaced first, then the one silent for longest. Holders are
  // replaced last.
  return *std::ranges::min_element(peers_, {}, [&](const Peer& each) {
    return std::tuple(holds(each), each.lived.has_value(), each.heard);
  }) = Peer();
}

const Peers::Peer* Peers::to_acknowledge(messages::Role role, bool holders_only) const {
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
    if (each.participant.role != role || group_of(each) != preferred) continue;
    if (turn == 0) return &each;
    --turn;
  }
  return nullptr;
}
std::string describe(const messages::Participant& who, std::string_view sender) {
  return fmt::format("the {} (process {}{}{}{}{})", messages::name(who.role), who.pid,
                     who.host.empty() ? "" : " on ", who.host, sender.empty() ? "" : ", ", sender);
}

std::string describe(const Peers::Peer& peer) { return describe(peer.participant, peer.sender); }

}  // namespace tachless::session
