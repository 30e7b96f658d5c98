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
/// over channel and payload. Announcements (…_PARTICIPANT) use a key derived from the bus's key.
/// All other messages use a key derived for the session, from the run's id and a random number of
/// each of the four processes. A recording of an earlier session therefore does not verify in a
/// later one, even with the same run id. A datagram that does not verify is dropped and counted.
/// Without a key every datagram passes.
///
/// The class does not encrypt and does not check freshness. Copies of announcements verify;
/// session::Membership makes them harmless. The tick protocol makes copies of the session's
/// messages harmless.
class Authenticated final : public Transport {
 public:
  Authenticated(Transport& inner, const std::optional<Key>& key);

  [[nodiscard]] bool has_key() const { return base_.has_value(); }

  /// Lets only the messages of this session verify from now on.
  /// @param run id of the run
  /// @param roster random numbers that the run's four processes have chosen
  void enter(std::int64_t run, const messages::PerRole& roster);

  int subscribe(const std::string& channel) override { return inner_.subscribe(channel); }
  /// @throw std::length_error if payload and tag do not fit one datagram
  void publish(std::string_view channel, std::span<const std::byte> payload) override;
  std::optional<Datagram> receive(base::Clock::time_point deadline) override;

  /// Returns the number of datagrams dropped because they did not verify.
  [[nodiscard]] std::int64_t dropped() const { return dropped_; }

  /// Returns the last stranger since the last call. After the session has begun no new strangers
  /// are noted.
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
