#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "process/file_descriptor.h"

namespace tachless::launch {

/// A stranger on the bus who has heard the run and sends what he likes: seeded, from a socket of
/// his own. Everything but a message that could have been the run's and is not: without keys that
/// is another participant, and ends the run by the protocol.
class Storm {
 public:
  static constexpr std::uint16_t port = 7667;

  explicit Storm(std::int64_t run, std::uint64_t seed = 5);

  /// A message of the run, to be bent and sent again.
  void hear(std::string_view channel, std::span<const std::byte> payload);

  /// The run is at this tick, or somewhat after it.
  void now_at(std::int64_t tick) { tick_ = tick; }

  /// Sends 1 to `longest` datagrams, one right after the other.
  void burst(std::int64_t longest);

  [[nodiscard]] std::int64_t sent() const { return sent_; }
  /// Whether this is how receivers call the storm's socket.
  [[nodiscard]] bool is(std::string_view sender) const { return sender.ends_with(port_text_); }

 private:
  using Bytes = std::vector<std::byte>;
  enum class Kind : int {
    random_bytes,
    truncated,
    lengthened,
    wrong_type,
    wrong_count,
    non_finite,
    bad_value,
    bad_text,
    other_run,
    stale,
    future,
    replayed,
    not_lcm,
    last = not_lcm
  };

  std::int64_t any(std::int64_t from, std::int64_t to) {
    return std::uniform_int_distribution<std::int64_t>(from, to)(random_);
  }
  void blow();
  const std::string& any_channel();
  const Bytes& any_heard(const std::string& channel);
  void send(std::string_view channel, std::span<const std::byte> payload);
  void send_datagram(std::span<const std::byte> bytes);
  void send_not_lcm();
  Bytes bent(Kind kind, std::string& channel);

  std::int64_t run_;
  std::int64_t tick_ = 0;
  std::int64_t sent_ = 0;
  std::mt19937_64 random_;
  process::FileDescriptor socket_;
  std::string port_text_;  ///< ":41234"
  Bytes datagram_;
  std::vector<std::string> channels_;
  std::map<std::string, std::deque<Bytes>, std::less<>> heard_;
};

}  // namespace tachless::launch
