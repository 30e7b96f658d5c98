#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/schema.h"
#include "messages/signals.h"

namespace tachless::reference::trajectory {

struct Waypoints;

/// A C4 spline through positions at given times, at rest through snap at both ends. Inner pieces
/// are quintic; the first and the last are of degree 7, which is what the extra end conditions
/// cost (two points only: degree 9). Before the first time it holds the first position, after the
/// last the last, so it is C4 everywhere.
class WaypointSpline {
 public:
  /// Solves for the spline, in time and memory linear in the number of points.
  /// @throw std::invalid_argument: `Waypoints::refusal` in one line.
  explicit WaypointSpline(const Waypoints& points);

  /// @param time_s strictly increasing, at least two
  /// @param position a column for each time, a row for each joint [rad; m if prismatic]
  WaypointSpline(std::vector<double> time_s, Eigen::MatrixXd position);

  /// Position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] messages::ReferencePoint at(double t_s) const;

  [[nodiscard]] const std::vector<double>& time_s() const { return time_s_; }

 private:
  std::vector<double> time_s_;
  Eigen::MatrixXd position_;
  double scale_ = 0;  ///< of time in `inner_` [s]
  /// Rows 2 k and 2 k + 1: velocity and acceleration at point k + 1, scaled; a column for each
  /// joint.
  Eigen::MatrixXd inner_;
};

/// Positions and when to be there.
struct Waypoints {
  std::vector<double> time_s;        ///< at least two, strictly increasing
  std::vector<Vector> position_rad;  ///< one per time, of one length [rad; m if prismatic]

  static constexpr std::string_view name = "waypoints";
  static constexpr std::tuple keys{
      base::Key{"time_s", &Waypoints::time_s, "s",
                "At least two, increasing: C4 spline, at rest at both ends"}
          .in(base::not_negative),
      base::Key{"position_rad", &Waypoints::position_rad, "rad (m)", "One entry per time"}};

  using Shape = WaypointSpline;

  /// Too few times, times out of order, or positions that are not one per time and of one length.
  [[nodiscard]] std::optional<base::Refusal> refusal() const;
};

/// Waypoints from a table, which stays a file: a scenario, its messages and its logs name it with a
/// digest of its bytes. Whoever reads the scenario's file reads the table too
/// (core/scenario/motion_file.h); who has the scenario from a log or a message has no motion.
struct MotionFile {
  std::string path;
  std::string digest;
  std::string time_column;  ///< name or number; empty: the column with a usual name of the time
  double time_scale = 1, time_offset = 0;
  std::shared_ptr<const WaypointSpline> motion;  ///< null where the file was not read

  static constexpr std::string_view name = "file";
  static constexpr std::tuple keys{
      base::Key{"path", &MotionFile::path, "",
                "Table of times and positions, relative to the scenario (docs/trajectories.md); "
                "`file: motion.csv` is short for `file: {path: motion.csv}`"},
      base::Key{"digest", &MotionFile::digest, "", "Of the table's bytes: another table is refused"}
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

  /// Position to snap at t [s]. Precondition: the file was read (`make_trajectory` sees to it).
  [[nodiscard]] messages::ReferencePoint at(double t_s) const { return motion->at(t_s); }
};

}  // namespace tachless::reference::trajectory
