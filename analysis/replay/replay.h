#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "logger/run_log.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "study/tracking.h"

/// Replays of the controller on a log's measurements and references. A replay shows whether the
/// commands are the same, or what another law or other gains would have commanded. Results are
/// text, JSON and a CSV table with both torques. Nothing is printed.
namespace tachless::replay {

/// A difference between a replayed and a recorded torque.
struct Mismatch {
  std::int64_t tick = 0;
  int joint = 0;                      ///< counted from 0
  double recorded = 0, replayed = 0;  ///< [N m; N]
  std::uint64_t ulps = 0;             ///< number of doubles from one to the other
};

/// Torques of one joint and their differences, replayed minus recorded, over the compared ticks [N
/// m; N].
struct JointTorques {
  study::Extent difference, recorded, replayed;
  std::int64_t peak_tick = -1;  ///< tick of the largest difference
};

/// The result of a replay.
struct Replay {
  std::int64_t compared = 0;   ///< ticks whose command was computed again and compared
  std::int64_t different = 0;  ///< compared ticks whose command is not the same bit for bit
  std::int64_t last_compared = -1;
  std::optional<Mismatch> first;  ///< the first difference
  std::vector<JointTorques> joints;
  std::uint64_t without_command = 0;  ///< ticks stepped through without a recorded command
  std::int64_t first_without_command = -1;
  std::uint64_t passed_over = 0;  ///< realtime: ticks on which the controller did not act
  /// Why nothing after `last_compared` could be computed; empty when the log was replayed to its
  /// end.
  std::string stopped_by;
  std::string simulator;    ///< of the plant, with its version; empty: the emulator or a robot
  bool not_finite = false;  ///< the replay stopped because the law's torque is not finite

  /// Returns whether every recorded command was computed again, without a gap.
  [[nodiscard]] bool complete() const { return stopped_by.empty() && without_command == 0; }
};

/// Returns the number of doubles from `a` to `b`; 0 when their bits are the same.
std::uint64_t ulps_between(double a, double b);

using OnCompared =
    std::function<void(std::int64_t tick, const Vector& recorded, const Vector& replayed)>;

/// Steps the law of `scenario` through the log's own measurements and references, from tick 0 on.
/// Compares its commands with the recorded commands. Reads `log` from its start to its end.
///
/// A law's memory depends on all previous ticks, so a tick without measurement or reference ends
/// the replay. A tick without a command is stepped through. Ticks after the last command belong to
/// the end of the run and are no gap. In realtime the controller may pass ticks over. The replay
/// passes over the ticks that have neither the controller's command nor its state
/// (controller::AnyLaw).
/// @param scenario the log's scenario, or that scenario with another law or other gains
/// @param law the law of `scenario`
/// @throw base::Failure(bad_usage) when the scenario has another number of joints or another period
/// than the log, or one is rigid and the other flexible
/// @throw base::Failure(bad_usage) when the law needs a measurement that the log does not have
Replay replay(logger::RunLog& log, const scenario::Scenario& scenario, controller::ScenarioLaw law,
              const OnCompared& on_compared = {});

/// Returns why some recorded commands could not be compared; empty when all were compared.
std::string hindrance(const Replay& replay, const logger::RunLog& log);

/// Returns why the recorded commands are not all verified as the same; empty when they are.
std::string problem_text(const Replay& replay, const logger::RunLog& log,
                         const robot::JointLabels& joints);

/// Returns what was verified, for a replay that took `wall_s` and has no problem.
std::string verified_text(const Replay& replay, const logger::RunLog& log, double wall_s);

/// Returns a text on the log's events that could not be read; empty when there are none.
std::string damage_text(const logger::RunLog& log);

/// Returns `{compared_ticks, different_ticks, last_compared_tick, complete, ticks_without_command,
/// ticks_passed_over, simulator, stopped_by, first_difference {tick, joint, recorded_Nm,
/// replayed_Nm, difference_Nm, ulps}, joints [{max_Nm, max_tick, rms_Nm, recorded_peak_Nm,
/// replayed_peak_Nm}]}`. A value that does not exist is null. Joints count from 1.
nlohmann::ordered_json to_json(const Replay& replay);

/// A replay with another law or other settings, and the files made of it.
struct Comparison {
  Replay replay;
  scenario::Scenario scenario;  ///< the log's scenario with the changes
  std::string title;
  std::filesystem::path csv;
};

/// Replays `log` with the settings `overrides` under the law that `make_law` makes. Writes
/// replay.csv into `out` (empty: beside the log). Its columns are tick, t_s, the recorded torques
/// (tau_elbow_Nm, …) and the replayed torques (tau_replayed_elbow_Nm, …).
/// @throw base::Failure(bad_usage) for a setting that no command depends on, an invalid scenario,
/// or a file that cannot be written
Comparison compare(logger::RunLog& log, const std::vector<std::string>& overrides,
                   const controller::MakeLaw& make_law, const std::filesystem::path& out,
                   const robot::JointLabels& labels);

/// Returns a text with the largest and rms difference per joint, and the files.
std::string comparison_text(const Comparison& comparison, const robot::JointLabels& labels,
                            double period_s);

}  // namespace tachless::replay
