#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "certify/prediction.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "session/statistics.h"
#include "study/tracking.h"
#include "study/verdict.h"

/// A run in numbers: summary.json and the closing table. Reads no log and writes no file.
namespace tachless::report {

/// Everything about a run that is neither in its scenario nor in its signals.
struct RunFacts {
  std::int64_t run_id = 0;
  double wall_s = 0;      ///< of the launcher; the plant's own figure is preferred
  std::string placement;  ///< of the processes on CPUs: "together on CPU 1"
  std::string log_path;
  std::int64_t log_ticks = 0;
  std::int64_t log_gaps = 0;
  std::optional<std::string> fault;
  std::optional<bool> robot_stopped;      ///< by its driver's `stop`; empty: no driver was started
  std::int64_t dropped_output_bytes = 0;  ///< of the processes, which wrote faster than was read
  std::int64_t hidden_output_lines = 0;
};

struct RunSummary {
  scenario::Scenario scenario;
  RunFacts facts;
  study::Tracking tracking;
  /// What the processes counted; a process that was killed has left none.
  std::vector<session::Statistics> statistics;
  study::Verdict verdict = {};
  certify::Prediction predicted = {};  ///< of the loop, before the run

  /// From the start of the run to its end, by the plant's clock where that is known.
  [[nodiscard]] double wall_s() const;
  /// Ticks of the run, by the plant's count where that is known: the log may lack some of them.
  [[nodiscard]] std::int64_t ticks() const;
  [[nodiscard]] double duration_s() const;  ///< of the motion

  /// What the plant counted; zeros when it has left nothing.
  [[nodiscard]] session::PlantStatistics plant() const;
};

/// The content of summary.json.
nlohmann::ordered_json to_json(const RunSummary& summary, const robot::JointLabels& joints);

/// The closing table: per joint error and torque, then how the run went.
std::string closing_table(const RunSummary& summary, const robot::JointLabels& joints);

/// "9.3 k", "412": a rate for people.
std::string short_rate(double per_s);

}  // namespace tachless::report
