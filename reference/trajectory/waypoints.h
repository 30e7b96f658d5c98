#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/schema.h"
#include "messages/signals.h"
#include "reference/trajectory/composition.h"

namespace tachless::reference::trajectory {

struct Waypoints;

/// A C4 spline through positions at given times, at rest through snap at both ends. Inner pieces
/// are quintic. The first and the last piece are of degree 7, because of the extra end conditions;
/// a single piece is of degree 9. The reference is the first position before the first time and the
/// last position after the last time.
class WaypointSpline {
 public:
  /// Solves for the spline. Time and memory are linear in the number of points.
  /// @throw std::invalid_argument: `Waypoints::refusal` in one line.
  explicit WaypointSpline(const Waypoints& points);

  /// @param time_s strictly increasing, at least two
  /// @param position a column for each time, a row for each joint [rad; m if prismatic]
  WaypointSpline(std::vector<double> time_s, Eigen::MatrixXd position);

  /// Returns position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] messages::ReferencePoint at(double t_s) const;

  [[nodiscard]] const std::vector<double>& time_s() const { return time_s_; }

 private:
  std::vector<double> time_s_;
  Eigen::MatrixXd position_;
  double scale_ = 0;  ///< unit of time in `inner_` [s]
  /// Rows 2 k and 2 k + 1: velocity and acceleration at point k + 1, scaled; a column for each
  /// joint.
  Eigen::MatrixXd inner_;
};

/// Positions and the times at which they are reached.
struct Waypoints {
  std::vector<double> time_s;        ///< times, at least two, strictly increasing
  std::vector<Vector> position_rad;  ///< one per time, of one length [rad; m if prismatic]

  static constexpr std::string_view name = "waypoints";
  static constexpr std::tuple keys{
      base::Key{"time_s", &Waypoints::time_s, "s",
                "At least two, increasing: C4 spline, at rest at both ends"}
          .in(base::not_negative),
      base::Key{"position_rad", &Waypoints::position_rad, "rad (m)", "One entry per time"}};

  using Shape = WaypointSpline;
  [[nodiscard]] Composition composition() const { return {time_s, {}}; }

  /// Returns the problem if there are too few times or the times do not increase. Also refuses
  /// positions of another number than the times, or of different lengths.
  [[nodiscard]] std::optional<base::Refusal> refusal() const;
};

/// Waypoints from a table, which stays a separate file. A scenario, its messages and its logs hold
/// the file's name and a digest of its bytes. The reader of the scenario's file reads the table too
/// (core/scenario/motion_file.h). A scenario from a log or a message has no motion.
struct MotionFile {
  std::string path;
  std::string digest;
  std::string time_column;  ///< name or number; empty: the column with a usual name of the time
  double time_scale = 1, time_offset = 0;
  std::shared_ptr<const WaypointSpline> motion;  ///< null if the file was not read

  static constexpr std::string_view name = "file";
  static constexpr std::tuple keys{
      base::Key{"path", &MotionFile::path, "",
                "Table of times and positions, relative to the scenario (docs/trajectories.md); "
                "`file: motion.csv` is short for `file: {path: motion.csv}`"},
      base::Key{"digest", &MotionFile::digest, "",
                "Digest of the table's bytes: another table is refused"}
          .by_default("that of the table found"),
      base::Key{"time_column", &MotionFile::time_column, "", "Name or number of the time's column"}
          .by_default("the column with a usual name of the time"),
      base::Key{"time_scale", &MotionFile::time_scale, "s",
                "Seconds per unit of the table's time: 0.001 for milliseconds"}
          .in(base::positive)
          .by_default(),
      base::Key{"time_offset", &MotionFile::time_offset, "s",
                "Added to the table's times after the scale: -261.6 starts a table from 261.6 s"}
          .by_default()};

  /// Returns position to snap at t [s]. Precondition: the file was read (`make_trajectory` checks
  /// it).
  [[nodiscard]] messages::ReferencePoint at(double t_s) const { return motion->at(t_s); }
  /// Returns the table's pieces; none if the file was not read.
  [[nodiscard]] Composition composition() const {
    if (motion == nullptr) return {};
    return {motion->time_s(), {}};
  }
};

}  // namespace tachless::reference::trajectory
