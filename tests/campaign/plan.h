#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "messages/messages.h"
#include "tests/support/in_memory.h"

namespace tachless::campaign {

/// Planned attacks. The attacker receives every datagram and acts at some of them.
struct Hostility {
  bool replays = false;       ///< messages of this run
  bool recordings = false;    ///< messages of an earlier run of the same scenario and run id
  bool forges = false;        ///< sets fields to extremes
  bool damages = false;       ///< changes bits and lengths
  bool contradicts = false;   ///< valid messages with other numbers
  bool acknowledges = false;  ///< acknowledges ticks instead of the logger
  bool announces = false;  ///< members' announcements: copies, earlier sessions', newer and altered
  bool names = false;      ///< texts that are commands, markup or paths in another program
  bool floods = false;     ///< garbage of all lengths, `flood_bytes` in all
  double rate = 0;         ///< probability of acting at a datagram
  int from = 0;            ///< number of datagrams received before it begins
  double races = 0;        ///< probability of a message before the honest sender's
  double drops = 0;        ///< probability that the honest message is then lost
  std::string sender = "an outsider";  ///< address that receivers see

  /// Returns whether it sends messages that no member has sent and that a receiver may believe.
  [[nodiscard]] bool lies() const {
    return forges || damages || contradicts || acknowledges || announces || names || races > 0;
  }
};

/// Bytes of garbage that one attacker sends in a round.
inline constexpr std::size_t flood_bytes = 8 << 20;

/// A disturbance of one of the four processes.
struct Mishap {
  enum class Kind { kill, stop, interrupt, fail };  ///< fail: its transport throws from then on
  Kind kind = Kind::kill;
  messages::Role role = messages::Role::plant;
  int at = 0;       ///< number of datagrams that the process has sent and received
  int stop_ms = 0;  ///< duration of a pause [ms]
};

enum class Pace {
  lockstep,
  realtime,       ///< 0.3 s
  realtime_long,  ///< longer than the time to notice a lost peer
};

/// A round of the campaign. The seed determines everything but the interleaving of the threads.
struct Plan {
  std::uint64_t seed = 0;
  Pace pace = Pace::lockstep;
  bool keyed = false;
  bus::NetworkFaults network;
  std::optional<Hostility> hostility;
  std::optional<Mishap> mishap;

  [[nodiscard]] bool lockstep() const { return pace == Pace::lockstep; }
  /// Returns whether the run must end well and with the clean log.
  [[nodiscard]] bool must_end_well() const;
};

Plan plan_of(std::uint64_t seed);
/// Returns e.g. "keyed lockstep, loss 0.2, replays, kill of the logger at 81".
std::string describe(const Plan& plan);
/// Returns the description without numbers, so that rounds of one kind are counted together.
std::string kind_of(const Plan& plan);

}  // namespace tachless::campaign
