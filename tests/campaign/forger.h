#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/field.h"

/// The fault campaign: docs/security.md.
namespace tachless::campaign {

/// A datagram as it was sent.
struct Sent {
  std::string channel;
  std::vector<std::byte> payload;
};

/// Where a value is in a message.
struct FieldAt {
  std::string_view name;
  std::size_t offset = 0;
  std::size_t size = 0;
  messages::Kind kind = messages::Kind::int64;
};

/// Every number and text of a message of robot ARM with two rigid joints and two signals, the
/// fingerprint, the stamp, counts and lengths of texts too. Stops where the payload ends.
std::vector<FieldAt> fields_of(std::string_view channel, std::span<const std::byte> payload);

/// Makes false messages of true ones. Knows the message types, and neither network nor run.
class Forger {
 public:
  explicit Forger(std::uint64_t seed) : random_(seed) {}

  /// One to three fields have other values: extremes of their kind, or near to what they were.
  std::vector<std::byte> forge(const Sent& honest);
  /// Passes all checks: the last number of it is another (PARTICIPANT: its state), no more.
  std::vector<std::byte> contradict(const Sent& honest);
  /// Bits flipped, cut off, or made longer.
  std::vector<std::byte> damage(const Sent& honest);
  /// PARTICIPANT or RUN_INFO with one text (a law, its signals, a host, a fault) that would be a
  /// command, markup or a path in another program; an announcement is newer than `honest`. Other
  /// messages have no text: unchanged.
  std::vector<std::byte> name(const Sent& honest);
  /// Random bytes, mostly short, at most 60,000.
  std::vector<std::byte> garbage();

 private:
  void change(std::span<std::byte> value, messages::Kind kind);
  std::uint64_t below(std::uint64_t bound) { return random_() % bound; }

  std::mt19937_64 random_;
};

}  // namespace tachless::campaign
