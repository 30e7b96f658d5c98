#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "bus/key.h"
#include "tests/campaign/forger.h"
#include "tests/campaign/plan.h"
#include "tests/system/four_threads.h"

namespace tachless::campaign {

/// An event of a log.
struct Event {
  std::string channel;
  std::int64_t tick = 0;
  std::string data;

  bool operator==(const Event&) const = default;
  /// Returns whether it is an announcement of a fault.
  [[nodiscard]] bool is_fault() const;
};

/// Facts of a round that the invariants check.
struct Evidence {
  Plan plan;
  std::int64_t num_ticks = 0;
  double period_s = 0;
  double give_up_s = 0;
  system_test::RunResult result;
  std::vector<Event> log;
  bool log_damaged = false;
  std::uintmax_t log_bytes = 0, clean_log_bytes = 0;
  std::vector<Event> clean_log;     ///< lockstep: log of the undisturbed run
  std::set<std::int64_t> lies;      ///< ticks for which an outsider has sent another message
  std::int64_t num_hostile = 0;     ///< datagrams sent by the attacker
  std::int64_t num_overflowed = 0;  ///< messages dropped because the logger's buffer was full
  bool mishap_happened = false;
  bool hung = false;  ///< the round had to be interrupted
  double wall_s = 0;

  [[nodiscard]] const system_test::Outcome& of(messages::Role role) const {
    return result.of.at(role);
  }
  /// Returns whether the member stays to the end.
  [[nodiscard]] bool lives(messages::Role role) const;
  [[nodiscard]] bool all_done() const { return result.complaints().empty(); }
};

/// A scenario of a round: scenarios/NAME.yaml with these overrides.
struct Experiment {
  std::string name;
  std::vector<std::string> overrides;
};
Experiment experiment_of(Pace pace);
bus::Key key();

/// Longest wait of the processes for each other [s].
inline constexpr double wait_s = 10;

/// Returns a round's evidence before it is played, with the clean log. The first call plays the
/// undisturbed run.
Evidence expected(const Plan& plan);
/// Returns all messages of that run, tagged as in `plan`, as an outsider may have recorded them.
const std::vector<Sent>& recording_for(const Plan& plan);

/// Reads the log of a round, if there is one.
void read_log(const std::filesystem::path& path, Evidence& into);

/// Plays a round in this process: the four nodes in four threads, with the plan's attacker, network
/// faults and mishap.
Evidence play(const Plan& plan);

}  // namespace tachless::campaign
