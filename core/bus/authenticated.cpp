#include "bus/authenticated.h"

#include <fmt/core.h>
#include <sodium.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "bus/lcm_packet.h"

namespace tachless::bus {
namespace {

constexpr std::string_view for_participants = "tachless participants";
constexpr std::string_view for_session = "tachless session";
constexpr int most_dropped = 64;  // in one call of `receive` after its deadline

bool is_announcement(std::string_view channel) {
  constexpr std::string_view suffix = messages::Participant::suffix;
  return channel.size() > suffix.size() && channel.ends_with(suffix) &&
         channel[channel.size() - suffix.size() - 1] == '_';
}

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text));
}

/// Returns a key for one purpose. Neither the bus's key nor another purpose's key can be computed
/// from it.
Key derived(const Key& base, std::string_view purpose, std::span<const std::byte> context) {
  Key result;
  Digest digest(Key::size, &base);
  digest.add(bytes_of(purpose));
  digest.add(context);
  digest.finish(result.bytes());
  return result;
}

std::array<unsigned char, tag_size> tag(const Key& key, std::string_view channel,
                                        std::span<const std::byte> payload) {
  std::array<unsigned char, tag_size> result{};
  Digest digest(tag_size, &key);
  digest.add(bytes_of(channel));
  digest.add(std::array{std::byte{0}});  // separates channel and payload
  digest.add(payload);
  digest.finish(result);
  return result;
}

}  // namespace

Authenticated::Authenticated(Transport& inner, const std::optional<Key>& key)
    : inner_(inner), base_(key), codec_(messages::Layout{}) {
  if (!key) return;
  participants_ = derived(*key, for_participants, {});
  tagged_.resize(lcm_packet::max_short_size);
}

void Authenticated::enter(std::int64_t run, const messages::PerRole& roster) {
  entered_ = true;
  if (!base_) return;
  std::array<std::byte, 8 * (1 + messages::num_roles)> context{};
  auto to = context.begin();
  const auto put = [&](std::int64_t number) {
    for (int i = 0; i < 8; ++i) {
      *to++ = static_cast<std::byte>(static_cast<std::uint64_t>(number) >> 8 * i);
    }
  };
  put(run);
  for (const std::int64_t instance : roster) put(instance);
  session_ = derived(*base_, for_session, context);
}

const Key* Authenticated::key_of(std::string_view channel) const {
  const std::optional<Key>& key = is_announcement(channel) ? participants_ : session_;
  return key ? &*key : nullptr;
}

void Authenticated::publish(std::string_view channel, std::span<const std::byte> payload) {
  if (!base_) return inner_.publish(channel, payload);
  const Key* key = key_of(channel);
  if (key == nullptr) {
    throw std::logic_error(fmt::format("a message for {} before the session", channel));
  }
  const std::size_t size = payload.size() + tag_size;
  if (size > tagged_.size()) {
    throw std::length_error(fmt::format("message on {} needs {} bytes, one datagram holds {}",
                                        channel, size, tagged_.size()));
  }
  const auto own = tag(*key, channel, payload);
  const auto end = std::ranges::copy(payload, tagged_.begin()).out;
  std::ranges::copy(std::as_bytes(std::span(own)), end);
  inner_.publish(channel, std::span(tagged_).first(size));
}

std::optional<Datagram> Authenticated::receive(base::Clock::time_point deadline) {
  if (!base_) {
    auto datagram = inner_.receive(deadline);
    if (datagram) note_stranger(*datagram);
    return datagram;
  }
  // Even in a flood of invalid datagrams the caller gets control back after the deadline.
  for (int dropped = 0; dropped < most_dropped || base::Clock::now() < deadline; ++dropped) {
    auto datagram = inner_.receive(deadline);
    if (!datagram || verify(*datagram)) return datagram;
    ++dropped_;
    note_stranger(*datagram);
  }
  return std::nullopt;
}

bool Authenticated::verify(Datagram& datagram) const {
  const Key* key = key_of(datagram.channel);
  if (key == nullptr || datagram.payload.size() < tag_size) return false;
  const auto payload = datagram.payload.first(datagram.payload.size() - tag_size);
  const auto expected = tag(*key, datagram.channel, payload);
  const auto given = datagram.payload.last(tag_size);
  if (sodium_memcmp(expected.data(), given.data(), tag_size) != 0) return false;
  datagram.payload = payload;
  return true;
}

void Authenticated::note_stranger(const Datagram& datagram) {
  // This is only noted before the session, because nothing may be allocated in the session.
  if (entered_ || !is_announcement(datagram.channel)) return;
  messages::Stamp stamp;
  const auto decodes = [&](std::span<const std::byte> payload, messages::Participant& who) {
    return codec_.decode(payload, stamp, who) == messages::Rejection::none;
  };
  Stranger stranger;
  stranger.tagged = !decodes(datagram.payload, stranger.who);
  if (stranger.tagged) {
    if (datagram.payload.size() <= tag_size) return;
    const auto untagged = datagram.payload.first(datagram.payload.size() - tag_size);
    if (!decodes(untagged, stranger.who)) return;
  } else if (!base_) {
    return;  // a process with this bus's setting: no key
  }
  stranger.sender = datagram.sender;
  stranger_ = std::move(stranger);
}

std::optional<Stranger> Authenticated::take_stranger() {
  return std::exchange(stranger_, std::nullopt);
}

}  // namespace tachless::bus
