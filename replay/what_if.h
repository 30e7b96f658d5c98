#pragma once

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "diagnostics/unfinished_file.h"
#include "replay/replay.h"
#include "robot/joint_labels.h"
#include "study/envelope.h"

namespace tachless::replay {

/// What another law, or other gains, would have commanded: recorded and replayed torques side by
/// side, as a CSV table and as a figure.
class WhatIf {
 public:
  /// Starts the table that `finish` puts at `csv`: tick, t_s, then tau_elbow_Nm (recorded) and
  /// tau_replayed_elbow_Nm, … .
  /// @throw diagnostics::Failure(bad_usage) when it cannot be written.
  WhatIf(std::filesystem::path csv, double period_s, robot::JointLabels labels);

  void add(std::int64_t tick, const robot::Vector& recorded, const robot::Vector& replayed);

  /// @throw diagnostics::Failure(bad_usage) when the disk refused.
  void finish();

  /// gnuplot commands for the figure.
  [[nodiscard]] std::string figure(const std::string& title,
                                   const std::filesystem::path& svg) const;

 private:
  struct Joint {
    study::Envelope recorded, replayed, difference;
  };
  diagnostics::UnfinishedFile file_;
  std::ofstream csv_;
  double period_s_;
  robot::JointLabels labels_;
  std::vector<Joint> joints_;
};

/// A log replayed with another law or other settings, and the files made of it.
struct Comparison {
  Replay replay;
  experiment::Scenario scenario;  ///< the log's, changed
  std::string title;
  std::filesystem::path csv, svg;  ///< there is no figure when no tick was compared
};

/// Replays `log` with the settings `overrides`, under the law that `make_law` makes, and writes
/// replay.csv and replay.svg into `out` (empty: beside the log).
/// @throw diagnostics::Failure(bad_usage) for a setting that no command depends on, a scenario that
/// is not valid, or a file that cannot be written
Comparison compare(logger::RunLog& log, const std::vector<std::string>& overrides,
                   const controller::MakeLaw& make_law, const std::filesystem::path& out,
                   const robot::JointLabels& labels);

/// Largest and rms difference per joint, and the files.
std::string comparison_text(const Comparison& comparison, const robot::JointLabels& labels,
                            double period_s);

/// `{compared_ticks, different_ticks, last_compared_tick, complete, ticks_without_command,
/// ticks_passed_over, stopped_by, first_difference {tick, joint, recorded_Nm, replayed_Nm,
/// difference_Nm, ulps}, joints [{max_Nm, max_tick, rms_Nm, recorded_peak_Nm, replayed_peak_Nm}]}`;
/// null where there is none. Joints count from 1.
nlohmann::ordered_json to_json(const Replay& replay);

}  // namespace tachless::replay
