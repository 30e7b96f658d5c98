#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "replay/replay.h"

/// What another law, or other gains, would have commanded: recorded and replayed torques side by
/// side, as a CSV table and as a figure.
namespace tachless::replay {

/// A log replayed with another law or other settings, and the files made of it.
struct Comparison {
  Replay replay;
  experiment::Scenario scenario;  ///< the log's, changed
  std::string title;
  std::filesystem::path csv, svg;  ///< there is no figure when no tick was compared
};

/// Replays `log` with the settings `overrides`, under the law that `make_law` makes, and writes
/// into `out` (empty: beside the log) replay.svg and replay.csv: tick, t_s, then tau_elbow_Nm
/// (recorded) and tau_replayed_elbow_Nm, … .
/// @throw diagnostics::Failure(bad_usage) for a setting that no command depends on, a scenario that
/// is not valid, or a file that cannot be written
Comparison compare(logger::RunLog& log, const std::vector<std::string>& overrides,
                   const controller::MakeLaw& make_law, const std::filesystem::path& out,
                   const robot::JointLabels& labels);

/// Largest and rms difference per joint, and the files.
std::string comparison_text(const Comparison& comparison, const robot::JointLabels& labels,
                            double period_s);

}  // namespace tachless::replay
