#include "bus/authenticated.h"

#include <sodium.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "bus/lcm_packet.h"

namespace tachless::bus {
namespace {

constexpr std::string_view for_participants = "tachless participants";
constexpr std::string_view for_session = "tachless session";
constexpr int most_dropped = 64;  // in one call

bool is_announcement(std::string_view channel) {
  constexpr std::string_view suffix = loop::MessageOf<loop::Participant>::suffix;
  return channel.size() > suffix.size() && channel.ends_with(suffix) &&
         channel[channel.size() - suffix.size() - 1] == '_';
}

const unsigned char* bytes_of(std::string_view text) {
  return reinterpret_cast<const unsigned char*>(text.data());
}

/// A key for one purpose, from which neither the bus's nor another can be found.
Key derived(const Key& base, std::string_view purpose, std::span<const unsigned char> context) {
  Key result;
  crypto_generichash_state state;
  crypto_generichash_init(&state, base.bytes().data(), Key::size, Key::size);
  crypto_generichash_update(&state, bytes_of(purpose), purpose.size());
  crypto_generichash_update(&state, context.data(), context.size());
  crypto_generichash_final(&state, result.bytes().data(), Key::size);
  sodium_memzero(&state, sizeof state);
  return result;
}

}  // namespace

std::optional<Foreign> foreign_participant(std::span<const std::byte> payload,
                                           const Codec<loop::Participant>& codec,
                                           loop::Participant& who) {
  loop::Stamp stamp;
  if (codec.decode(payload, stamp, who) == Rejection::none) return Foreign::untagged;
  if (payload.size() > tag_size &&
      codec.decode(payload.first(payload.size() - tag_size), stamp, who) == Rejection::none) {
    return Foreign::other_key;
  }
  return std::nullopt;
}

Authenticated::Authenticated(Transport& inner, const Key& key)
    : inner_(inner),
      base_(key),
      participants_(derived(key, for_participants, {})),
      tagged_(lcm_packet::max_short_size),
      codec_(loop::Layout{}) {}

void Authenticated::enter(std::int64_t run, const loop::PerRole& roster) {
  std::array<unsigned char, 8 * (1 + loop::num_roles)> context{};
  auto to = context.begin();
  const auto put = [&](std::int64_t number) {
    for (int i = 0; i < 8; ++i) {
      *to++ = static_cast<unsigned char>(static_cast<std::uint64_t>(number) >> 8 * i);
    }
  };
  put(run);
  for (const std::int64_t instance : roster) put(instance);
  session_ = derived(base_, for_session, context);
}

Authenticated::Tag Authenticated::tag(const Key& key, std::string_view channel,
                                      std::span<const std::byte> payload) const {
  Tag result;
  const unsigned char nul = 0;
  crypto_generichash_state state;
  crypto_generichash_init(&state, key.bytes().data(), Key::size, result.size());
  crypto_generichash_update(&state, bytes_of(channel), channel.size());
  crypto_generichash_update(&state, &nul, 1);  // where the channel ends
  crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(payload.data()),
                            payload.size());
  crypto_generichash_final(&state, result.data(), result.size());
  return result;
}

const Key* Authenticated::key_of(std::string_view channel) const {
  if (is_announcement(channel)) return &participants_;
  return session_ ? &*session_ : nullptr;
}

void Authenticated::publish(std::string_view channel, std::span<const std::byte> payload) {
  const Key* key = key_of(channel);
  if (key == nullptr) {
    throw std::logic_error("a message for " + std::string(channel) + " before the session");
  }
  if (payload.size() + tag_size > tagged_.size()) {
    throw std::length_error("message on " + std::string(channel) + " needs " +
                            std::to_string(payload.size() + tag_size) +
                            " bytes, one datagram holds " + std::to_string(tagged_.size()));
  }
  const Tag own = tag(*key, channel, payload);
  std::ranges::copy(payload, tagged_.begin());
  std::ranges::copy(std::as_bytes(std::span(own)),
                    tagged_.begin() + static_cast<std::ptrdiff_t>(payload.size()));
  inner_.publish(channel, std::span(tagged_).first(payload.size() + tag_size));
}

std::optional<Datagram> Authenticated::receive(loop::Clock::time_point deadline) {
  for (int dropped = 0; dropped < most_dropped; ++dropped) {
    auto datagram = inner_.receive(deadline);
    if (!datagram || verify(*datagram)) return datagram;
    ++dropped_;
    if (is_announcement(datagram->channel)) note_stranger(*datagram);
  }
  // A flood must not keep the caller from looking at the clock.
  return std::nullopt;
}

bool Authenticated::verify(Datagram& datagram) const {
  const Key* key = key_of(datagram.channel);
  if (key == nullptr || datagram.payload.size() < tag_size) return false;
  const auto payload = datagram.payload.first(datagram.payload.size() - tag_size);
  const Tag expected = tag(*key, datagram.channel, payload);
  const auto given = datagram.payload.last(tag_size);
  if (sodium_memcmp(expected.data(), given.data(), tag_size) != 0) return false;
  datagram.payload = payload;
  return true;
}

void Authenticated::note_stranger(const Datagram& datagram) {
  // Only while there is no session: afterwards nobody asks, and nothing may be allocated.
  if (session_) return;
  Stranger stranger;
  const auto kind = foreign_participant(datagram.payload, codec_, stranger.who);
  if (!kind) return;
  stranger.kind = *kind;
  stranger.sender = datagram.sender;
  stranger_ = std::move(stranger);
}

std::optional<Authenticated::Stranger> Authenticated::take_stranger() {
  return std::exchange(stranger_, std::nullopt);
}

}  // namespace tachless::bus
