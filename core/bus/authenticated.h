#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bus/key.h"
#include "bus/transport.h"
#include "messages/wire.h"

namespace tachless::bus {

/// Bytes of the tag at the end of every authenticated payload.
inline constexpr std::size_t tag_size = 16;

/// An announcement that decodes but does not verify: its sender has another key, or only one of the
/// two has a key.
struct Stranger {
  bool tagged = false;
  messages::Participant who;
  std::string sender;
};

/// A transport that appends and checks a message authentication code: 16 bytes of keyed BLAKE2b
/// over channel and payload. Announcements (…_PARTICIPANT) use a key derived from the bus's; all
/// other messages use one derived for the session, from the run's id and a random number of each of
/// the four processes, so that nothing recorded in an earlier session verifies in a later one, with
/// the same run id or not. What does not verify is dropped and counted. Without a key everything
/// passes. Does not encrypt and does not check freshness: copies of announcements verify and are
/// made harmless by session::Membership, copies of messages of the session by the tick protocol.
class Authenticated final : public Transport {
 public:
  Authenticated(Transport& inner, const std::optional<Key>& key);

  [[nodiscard]] bool has_key() const { return base_.has_value(); }

  /// From now on only the messages of this session verify.
  /// @param run its id  @param roster random numbers that its four processes have chosen
  void enter(std::int64_t run, const messages::PerRole& roster);

  int subscribe(const std::string& channel) override { return inner_.subscribe(channel); }
  /// @throw std::length_error when payload and tag do not fit one datagram
  void publish(std::string_view channel, std::span<const std::byte> payload) override;
  std::optional<Datagram> receive(base::Clock::time_point deadline) override;

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
  messages::Codec<messages::Participant> codec_;
  std::optional<Stranger> stranger_;
};

}  // namespace tachless::bus
