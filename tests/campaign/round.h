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
  /// An announcement of a fault.
  [[nodiscard]] bool is_fault() const;
};

/// What is judged of a round.
struct Evidence {
  Plan plan;
  std::int64_t num_ticks = 0;
  double period_s = 0;
  double give_up_s = 0;
  system_test::RunResult result;
  std::vector<Event> log;
  bool log_damaged = false;
  std::uintmax_t log_bytes = 0, clean_log_bytes = 0;
  std::vector<Event> clean_log;     ///< lockstep: of the run that nothing happened to
  std::set<std::int64_t> lies;      ///< ticks for which an outsider has said something else
  std::int64_t num_hostile = 0;     ///< datagrams of the attacker
  std::int64_t num_overflowed = 0;  ///< messages that the logger had no room for
  bool mishap_happened = false;
  bool hung = false;  ///< had to be interrupted
  double wall_s = 0;

  [[nodiscard]] const system_test::Outcome& of(messages::Role role) const {
    return result.of.at(role);
  }
  /// Whether the member is there to the end.
  [[nodiscard]] bool lives(messages::Role role) const;
  [[nodiscard]] bool all_done() const { return result.complaints().empty(); }
};

/// What is run: scenarios/NAME.yaml with these overrides.
struct Experiment {
  std::string name;
  std::vector<std::string> overrides;
};
Experiment experiment_of(Pace pace);
bus::Key key();

/// All wait so long for each other at most [s].
inline constexpr double wait_s = 10;

/// A round's evidence before it is played: what it is compared with. Plays, when first asked, the
/// run that nothing happens to.
Evidence expected(const Plan& plan);
/// Everything that was said in that run, tagged as in `plan`: what an outsider may have recorded.
const std::vector<Sent>& recording_for(const Plan& plan);

/// Reads the log of a round, if there is one.
void read_log(const std::filesystem::path& path, Evidence& into);

/// Plays a round in this process: the four nodes in four threads, with the plan's attacker, faults
/// and mishaps.
Evidence play(const Plan& plan);

}  // namespace tachless::campaign
