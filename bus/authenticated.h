#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bus/key.h"
#include "bus/transport.h"
#include "bus/wire.h"

namespace tachless::bus {

/// Bytes of the tag at the end of every authenticated payload.
inline constexpr std::size_t tag_size = 16;

/// A participant's announcement that does not verify though it is no garbage: its bus has another
/// key, or one of the two has none.
struct Stranger {
  bool tagged = false;
  loop::Participant who;
  std::string sender;
};

/// A bus on which only holders of the key are heard. Every payload carries a tag of 16 bytes at its
/// end, keyed BLAKE2b over channel and payload: announcements (…_PARTICIPANT) under a key derived
/// from the bus's, everything else under one that is derived for the session besides, to which each
/// of the four has contributed a random number, so that nothing recorded in an earlier session
/// verifies in a later one, the same run id or not. What does not verify is dropped and counted.
/// Without a key everything passes as it is.
/// Does not encrypt, and does not know what is fresh: copies of announcements verify, and
/// protocol::Membership makes them harmless; so do copies of messages of the same session, and the
/// tick protocol does.
class Authenticated final : public Transport {
 public:
  Authenticated(Transport& inner, const std::optional<Key>& key);

  [[nodiscard]] bool has_key() const { return base_.has_value(); }

  /// From now on the messages of this session verify, and no others'.
  /// @param run its id  @param roster random numbers that its four processes have chosen
  void enter(std::int64_t run, const loop::PerRole& roster);

  void subscribe(const std::string& channel) override { inner_.subscribe(channel); }
  /// @throw std::length_error when payload and tag do not fit one datagram
  void publish(std::string_view channel, std::span<const std::byte> payload) override;
  std::optional<Datagram> receive(loop::Clock::time_point deadline) override;

  /// Datagrams dropped because they did not verify.
  [[nodiscard]] std::int64_t dropped() const { return dropped_; }

  /// The last one since the last call, before the session.
  std::optional<Stranger> take_stranger();

 private:
  [[nodiscard]] bool verify(Datagram& datagram) const;
  [[nodiscard]] const Key* key_of(std::string_view channel) const;
  void note_stranger(const Datagram& datagram);

  Transport& inner_;
  std::optional<Key> base_, participants_, session_;
  bool entered_ = false;
  std::vector<std::byte> tagged_;
  std::int64_t dropped_ = 0;
  Codec<loop::Participant> codec_;
  std::optional<Stranger> stranger_;
};

}  // namespace tachless::bus
