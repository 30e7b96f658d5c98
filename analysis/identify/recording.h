#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>

#include "logger/run_log.h"
#include "scenario/scenario.h"

/// Rotor inertia, friction and payload of a robot with rigid joints, from logs of its own runs:
/// measured positions and applied torques. No velocity is measured, and the truth of an emulator is
/// not read.
namespace tachless::identify {

/// What identification reads of a run.
struct Recording {
  std::string source;  ///< the log's file
  scenario::Scenario scenario;
  Eigen::MatrixXd q;    ///< measured positions [rad; m], a row per tick
  Eigen::MatrixXd tau;  ///< applied over the tick [N m; N], likewise
  /// By the scenario's law, which can be simulated, with torques held over each tick; otherwise
  /// torques are of the instant of the positions.
  bool controlled = true;

  [[nodiscard]] Eigen::Index num_ticks() const { return q.rows(); }
};

/// Positions and torques in a log, as in a Recording.
struct Ticks {
  Eigen::MatrixXd q, tau;
  std::int64_t missed = 0, saturated = 0;  ///< ticks without a command, with a torque at its limit
};
/// @param to_stop not from a protective stop on
/// @throw base::Failure(bad_usage) when positions of the joints are not recorded
Ticks read_ticks(logger::RunLog& log, bool to_stop = false);

/// @throw base::Failure(bad_usage), one line that says what the log lacks: the joints are
/// flexible or their positions not recorded, ticks or commands are missing, a torque was at its
/// limit in more than 1 % of the ticks, the run is shorter than 2 s, or no joint moves
Recording read_recording(const std::filesystem::path& log);

/// From the table of another logger, as a YAML file beside it says what its columns are
/// (docs/identification.md), on an even grid of the median of its steps.
/// @throw base::Failure(bad_usage), one line: file, line, what is wrong, what is allowed
Recording read_table(const std::filesystem::path& description);

/// @throw base::Failure(bad_usage) for less than 2 s, or when no joint moves
void require_usable(const Recording& recording);

/// @throw base::Failure(bad_usage) unless both are of the same URDF, joints and gravity
void require_same_robot(const Recording& first, const Recording& other);

}  // namespace tachless::identify
