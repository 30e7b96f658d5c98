#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "certify/prediction.h"
#include "report/contacts.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "session/statistics.h"
#include "study/tracking.h"
#include "study/verdict.h"

/// A run in numbers: summary.json and the closing table. This code reads no log and writes no file.
namespace tachless::report {

/// Everything about a run that is neither in its scenario nor in its signals.
struct RunFacts {
  std::int64_t run_id = 0;
  double wall_s = 0;      ///< time by the launcher; the plant's own figure is preferred
  std::string placement;  ///< placement of the processes on CPUs: "together on CPU 1"
  std::string log_path;
  std::int64_t log_ticks = 0;
  std::int64_t log_gaps = 0;
  std::optional<std::string> fault;
  /// The `stop` of the robot's driver has returned; empty: no driver was started.
  std::optional<bool> robot_stopped;
  std::int64_t dropped_output_bytes = 0;  ///< output written faster than it was read
  std::int64_t hidden_output_lines = 0;
};

struct RunSummary {
  scenario::Scenario scenario;
  RunFacts facts;
  study::Tracking tracking;
  /// The counters of the processes. A process that was killed has left none.
  std::vector<session::Statistics> statistics;
  study::Verdict verdict = {};
  certify::Prediction predicted = {};  ///< prediction of the loop, before the run
  Contacts contacts = {};

  /// Returns the time from the start of the run to its end, by the plant's clock if that is known.
  [[nodiscard]] double wall_s() const;
  /// Returns the ticks of the run, by the plant's count if that is known. The log may lack some.
  [[nodiscard]] std::int64_t ticks() const;
  [[nodiscard]] double duration_s() const;  ///< duration of the motion

  /// Returns the plant's counters; zeros if it has left none.
  [[nodiscard]] session::PlantStatistics plant() const;
};

/// Returns the content of summary.json.
nlohmann::ordered_json to_json(const RunSummary& summary, const robot::JointLabels& joints);

/// Returns the closing table: each joint's error and torque, then the run's outcome.
std::string closing_table(const RunSummary& summary, const robot::JointLabels& joints);

/// Returns a rate for people: "9.3 k", "412".
std::string short_rate(double per_s);

}  // namespace tachless::report
