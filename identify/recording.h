#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>

#include "experiment/scenario.h"

/// Rotor inertia, friction and payload of a robot with rigid joints, from logs of its own runs:
/// measured positions and applied torques. No velocity is measured, and the truth of an emulator is
/// not read.
namespace tachless::identify {

/// What identification reads of a run.
struct Recording {
  std::string source;  ///< the log's file
  experiment::Scenario scenario;
  Eigen::MatrixXd q;    ///< measured positions [rad; m], a row per tick
  Eigen::MatrixXd tau;  ///< applied over the tick [N m; N], likewise

  [[nodiscard]] Eigen::Index num_ticks() const { return q.rows(); }
};

/// @throw diagnostics::Failure(bad_usage), one line that says what the log lacks: the joints are
/// flexible or their positions not recorded, ticks or commands are missing, a torque was at its
/// limit in more than 1 % of the ticks, the run is shorter than 2 s, or no joint moves
Recording read_recording(const std::filesystem::path& log);

/// @throw diagnostics::Failure(bad_usage) unless both are of the same URDF, joints and gravity
void require_same_robot(const Recording& first, const Recording& other);

}  // namespace tachless::identify
