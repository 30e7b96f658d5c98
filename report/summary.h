#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "report/tracking.h"

namespace tachless::report {

/// Everything about a run that is not in its signals.
struct RunFacts {
  std::string scenario;
  std::int64_t run_id = 0;
  std::string mode;
  std::string law;
  double period_s = 0;
  double wall_s = 0;  ///< of the launcher; the plant's own figure is preferred
  std::string log_path;
  std::int64_t log_ticks = 0;
  std::int64_t log_gaps = 0;
  std::optional<std::string> fault;
};

/// The content of summary.json. `counters` are what the processes wrote at their end (objects
/// with the key "role"); a process that was killed has written none.
nlohmann::ordered_json summarise(const RunFacts& facts, const report::Tracking& tracking,
                                 const std::vector<nlohmann::json>& counters);

/// The closing table: per joint error and torque, then how the run went.
std::string closing_table(const nlohmann::ordered_json& summary,
                          const std::vector<std::string>& length_units,
                          const std::vector<std::string>& effort_units);

/// "50 µs", "1 ms": a period for people.
std::string short_period(double period_s);

/// "9.3 k", "412": a rate for people.
std::string short_rate(double per_s);

}  // namespace tachless::report
