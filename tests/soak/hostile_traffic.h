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

namespace tachless::soak {

/// Sends mutated messages of a run, and bytes that are no messages, from a socket of its own;
/// seeded. It never sends a message that the run could have sent and has not: without keys such a
/// sender is a participant, and ends the run by the protocol. It does not listen: samples are given
/// to it.
class HostileTraffic {
 public:
  static constexpr std::uint16_t port = 7667;

  explicit HostileTraffic(std::int64_t run, std::uint64_t seed = 5);

  /// A message of the run, to be mutated and sent.
  void add_sample(std::string_view channel, std::span<const std::byte> payload);

  /// The run is at this tick, or somewhat after it.
  void now_at(std::int64_t tick) { tick_ = tick; }

  /// Sends 1 to `longest` datagrams, one right after the other.
  void send(std::int64_t longest);

  [[nodiscard]] std::int64_t sent() const { return sent_; }
  /// Whether this is how receivers call this socket.
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
  void send_one();
  const std::string& any_channel();
  const Bytes& any_sample(const std::string& channel);
  void send_as_lcm(std::string_view channel, std::span<const std::byte> payload);
  void send_datagram(std::span<const std::byte> bytes);
  void send_not_lcm();
  Bytes mutate(Kind kind, std::string& channel);

  std::int64_t run_;
  std::int64_t tick_ = 0;
  std::int64_t sent_ = 0;
  std::mt19937_64 random_;
  process::FileDescriptor socket_;
  std::string port_text_;  ///< ":41234"
  Bytes datagram_;
  std::vector<std::string> channels_;
  std::map<std::string, std::deque<Bytes>, std::less<>> samples_;
};

}  // namespace tachless::soak
