#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "logger/run_log.h"
#include "scenario/scenario.h"

/// Identification of a rigid robot's parameters from logs of its own runs. It uses measured
/// positions and applied torques. It needs no measured velocity and does not read an emulator's
/// true state.
namespace tachless::identify {

/// The data of a run that identification reads.
struct Recording {
  std::string source;  ///< path of the log
  scenario::Scenario scenario;
  Eigen::MatrixXd q;    ///< measured positions [rad; m], a row per tick
  Eigen::MatrixXd tau;  ///< applied over the tick [N m; N], a row per tick
  /// True if the scenario's law controlled the run, with torques held over each tick. The run
  /// can then be simulated. Otherwise torques and positions are of the same instant.
  bool controlled = true;
  /// Ticks by which the torques of a table have been moved: row k holds the torque that the table
  /// has `moved` rows earlier, interpolated if this is no whole number.
  double moved = 0;
  bool loaded = true;  ///< the arm carried the load that is to be identified

  [[nodiscard]] Eigen::Index num_ticks() const { return q.rows(); }
};

/// Positions and torques of a log, in the form of a Recording.
struct Ticks {
  Eigen::MatrixXd q, tau;
  /// Ticks without a command; ticks with a torque at its limit.
  std::int64_t missed = 0, saturated = 0;
};

/// A matrix that grows by a row for each tick.
class TickRows {
 public:
  void add(const Vector& row) { numbers_.insert(numbers_.end(), row.begin(), row.end()); }
  /// Returns the rows so far, with so many columns.
  [[nodiscard]] Eigen::MatrixXd matrix(Eigen::Index columns) const;

 private:
  std::vector<double> numbers_;
};

/// Reads positions and torques from a log.
/// @param to_stop leave out the ticks from a protective stop on
/// @throw base::Failure(bad_usage) when positions of the joints are not recorded
Ticks read_ticks(logger::RunLog& log, bool to_stop = false);

/// Reads a recording from a log.
/// @throw base::Failure(bad_usage), one line, if the robot has flexible joints
/// @throw base::Failure(bad_usage), one line, if positions are not recorded, or ticks or commands
/// are missing
/// @throw base::Failure(bad_usage), one line, for a dry run, withheld torques, changing gains, a
/// torque at its limit in more than 1 % of the ticks, less than 2 s, or no joint that moves
Recording read_recording(const std::filesystem::path& log);

/// Reads a recording from another logger's table. The YAML file `description` names the table's
/// columns (docs/identification.md). Interpolates on an even grid whose step is the median step of
/// the table.
/// @throw base::Failure(bad_usage) with one line: file, line, fault and allowed values
Recording read_table(const std::filesystem::path& description);

/// Returns a table's recording with its torques moved by so many ticks. Torques between two rows
/// are those of the cubic through four rows. Rows without a torque are left out.
/// @param recording a table whose torques have not been moved
Recording with_torques_moved(const Recording& recording, double ticks);

/// Checks the length and motion of a recording.
/// @throw base::Failure(bad_usage) for less than 2 s, or when no joint moves
void require_usable(const Recording& recording);

/// Checks that both recordings are of the same robot.
/// @throw base::Failure(bad_usage) when URDF, locked joints, base or gravity differ
void require_same_robot(const Recording& first, const Recording& other);

}  // namespace tachless::identify
