#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/field.h"

/// The fault campaign; docs/security.md describes it.
namespace tachless::campaign {

/// A sent datagram.
struct Sent {
  std::string channel;
  std::vector<std::byte> payload;
};

/// Position of a value in a message.
struct FieldAt {
  std::string_view name;
  std::size_t offset = 0;
  std::size_t size = 0;
  messages::Kind kind = messages::Kind::int64;
};

/// Returns every number and text of a message of robot ARM with two rigid joints and two signals.
/// The fingerprint, the stamp, counts and lengths of texts are included. The list stops at the end
/// of the payload.
std::vector<FieldAt> fields_of(std::string_view channel, std::span<const std::byte> payload);

/// Maker of false messages from true ones. It knows the message types, but no network and no run.
class Forger {
 public:
  explicit Forger(std::uint64_t seed) : random_(seed) {}

  /// Changes one to three fields to extremes of their kind, or to values near the true ones.
  std::vector<std::byte> forge(const Sent& honest);
  /// Changes only the last number (PARTICIPANT: its state), so that the message passes all checks.
  std::vector<std::byte> contradict(const Sent& honest);
  /// Flips bits, cuts the message off, or makes it longer.
  std::vector<std::byte> damage(const Sent& honest);
  /// Changes one text (a law, its signals, a host, a fault) of PARTICIPANT or RUN_INFO into a
  /// command, markup or path for another program. An announcement becomes newer than `honest`.
  /// Other messages have no text and stay unchanged.
  std::vector<std::byte> name(const Sent& honest);
  /// Returns random bytes, mostly few, at most 60,000.
  std::vector<std::byte> garbage();

 private:
  void change(std::span<std::byte> value, messages::Kind kind);
  std::uint64_t below(std::uint64_t bound) { return random_() % bound; }

  std::mt19937_64 random_;
};

}  // namespace tachless::campaign
