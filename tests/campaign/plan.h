#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "messages/messages.h"
#include "tests/support/in_memory.h"

namespace tachless::campaign {

/// The deeds of the attacker, which receives everything. It acts at some of the datagrams that it
/// receives.
struct Hostility {
  bool replays = false;       ///< of this run
  bool recordings = false;    ///< of an earlier run of the same scenario and run id
  bool forges = false;        ///< fields at extremes
  bool damages = false;       ///< bits, lengths
  bool contradicts = false;   ///< sound messages with other numbers
  bool acknowledges = false;  ///< in the logger's place, what it may not have
  bool announces = false;  ///< members' announcements: copies, earlier sessions', newer and altered
  bool names = false;      ///< texts that would be commands, markup or paths in another program
  bool floods = false;     ///< garbage of all lengths, `flood_bytes` in all
  double rate = 0;         ///< probability to act at a datagram
  int from = 0;            ///< it has received so many before it begins
  double races = 0;        ///< probability that it answers before the honest sender does
  double drops = 0;        ///< … and that the honest answer is lost then
  std::string sender = "an outsider";  ///< address that receivers see

  /// Sends what no member has ever sent and what a receiver may believe.
  [[nodiscard]] bool lies() const {
    return forges || damages || contradicts || acknowledges || announces || names || races > 0;
  }
};

/// Garbage that one attacker sends in a round [bytes].
inline constexpr std::size_t flood_bytes = 8 << 20;

/// What happens to one of the four.
struct Mishap {
  enum class Kind { kill, stop, interrupt, fail };  ///< fail: its transport throws from then on
  Kind kind = Kind::kill;
  messages::Role role = messages::Role::plant;
  int at = 0;       ///< it has sent and received so many datagrams
  int stop_ms = 0;  ///< how long it stands still
};

enum class Pace {
  lockstep,
  realtime,       ///< 0.3 s
  realtime_long,  ///< longer than it takes to notice that a peer is lost
};

/// A round of the campaign; everything follows from the seed but the threads' interleaving.
struct Plan {
  std::uint64_t seed = 0;
  Pace pace = Pace::lockstep;
  bool keyed = false;
  bus::NetworkFaults network;
  std::optional<Hostility> hostility;
  std::optional<Mishap> mishap;

  [[nodiscard]] bool lockstep() const { return pace == Pace::lockstep; }
  /// Whether nothing may keep the run from its good end and its clean log.
  [[nodiscard]] bool must_end_well() const;
};

Plan plan_of(std::uint64_t seed);
/// "keyed lockstep, loss 0.2, replays, kill of the logger at 81"
std::string describe(const Plan& plan);
/// The same without numbers: rounds of one kind are counted together.
std::string kind_of(const Plan& plan);

}  // namespace tachless::campaign
