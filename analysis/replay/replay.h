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

/// The controller again, on what a log recorded: whether its commands are the same, and what
/// another law, or other gains, would have commanded, in words and as JSON, and that side by side
/// as a CSV table and a figure. Prints nothing.
namespace tachless::replay {

/// Where a replayed command is not the recorded one.
struct Mismatch {
  std::int64_t tick = 0;
  int joint = 0;  ///< counted from 0
  double recorded = 0, replayed = 0;
  std::uint64_t ulps = 0;  ///< doubles from one to the other
};

/// Torques of one joint, and replayed minus recorded, over the ticks compared [N m; N].
struct JointTorques {
  study::Extent difference, recorded, replayed;
  std::int64_t peak_tick = -1;  ///< of the difference
};

/// What came of a replay.
struct Replay {
  std::int64_t compared = 0;   ///< ticks whose command was computed again and compared
  std::int64_t different = 0;  ///< those of them whose command is not the same bit for bit
  std::int64_t last_compared = -1;
  std::optional<Mismatch> first;  ///< the first difference
  std::vector<JointTorques> joints;
  std::uint64_t without_command = 0;  ///< ticks stepped through that have no command to compare
  std::int64_t first_without_command = -1;
  std::uint64_t passed_over = 0;  ///< realtime: ticks that the controller did not act on
  /// Why nothing beyond `last_compared` could be computed; empty when the log was replayed to its
  /// end.
  std::string stopped_by;
  bool not_finite = false;  ///< it was because the law's torque is not finite

  /// Every recorded command was computed again: no gap lay in the way.
  [[nodiscard]] bool complete() const { return stopped_by.empty() && without_command == 0; }
};

/// Doubles from `a` to `b`, 0 when their bits are the same.
std::uint64_t ulps_between(double a, double b);

using OnCompared =
    std::function<void(std::int64_t tick, const Vector& recorded, const Vector& replayed)>;

/// Steps the law of `scenario` through the log's own measurements and references, from tick 0 on,
/// and compares its commands with the recorded ones. `scenario` is the log's, or the log's with
/// another law or other gains, and `law` its law. Reads `log` from its start to its end.
///
/// A law's memory holds all ticks before: a tick without measurement or reference ends what can
/// be computed. A tick without a command is stepped through. Ticks after the last command are
/// where the run was ended, no gap. In realtime the controller may have passed ticks over: those
/// with neither its command nor its state are passed over likewise (controller::AnyLaw).
/// @throw base::Failure(bad_usage) when the scenario is not one for this log: another number
/// of joints, another period, rigid for flexible joints, a law that needs more than was measured.
Replay replay(logger::RunLog& log, const scenario::Scenario& scenario, controller::ScenarioLaw law,
              const OnCompared& on_compared = {});

/// What hinders a full verdict; empty when nothing does.
std::string hindrance(const Replay& replay, const logger::RunLog& log);

/// Why the recorded commands are not all verified as the same; empty when they are.
std::string problem_text(const Replay& replay, const logger::RunLog& log,
                         const robot::JointLabels& joints);

/// What was verified, after a replay that took `wall_s` and has no problem.
std::string verified_text(const Replay& replay, const logger::RunLog& log, double wall_s);

/// Events of the log that could not be read; empty when there are none.
std::string damage_text(const logger::RunLog& log);

/// `{compared_ticks, different_ticks, last_compared_tick, complete, ticks_without_command,
/// ticks_passed_over, stopped_by, first_difference {tick, joint, recorded_Nm, replayed_Nm,
/// difference_Nm, ulps}, joints [{max_Nm, max_tick, rms_Nm, recorded_peak_Nm, replayed_peak_Nm}]}`;
/// null where there is none. Joints count from 1.
nlohmann::ordered_json to_json(const Replay& replay);

/// A log replayed with another law or other settings, and the files made of it.
struct Comparison {
  Replay replay;
  scenario::Scenario scenario;  ///< the log's, changed
  std::string title;
  std::filesystem::path csv;
};

/// Replays `log` with the settings `overrides`, under the law that `make_law` makes, and writes
/// into `out` (empty: beside the log) replay.csv: tick, t_s, then tau_elbow_Nm
/// (recorded) and tau_replayed_elbow_Nm, … .
/// @throw base::Failure(bad_usage) for a setting that no command depends on, a scenario that
/// is not valid, or a file that cannot be written
Comparison compare(logger::RunLog& log, const std::vector<std::string>& overrides,
                   const controller::MakeLaw& make_law, const std::filesystem::path& out,
                   const robot::JointLabels& labels);

/// Largest and rms difference per joint, and the files.
std::string comparison_text(const Comparison& comparison, const robot::JointLabels& labels,
                            double period_s);

}  // namespace tachless::replay
