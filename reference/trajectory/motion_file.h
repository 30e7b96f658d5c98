#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

#include "loop/signals.h"
#include "reference/trajectory/waypoints.h"
#include "schema/schema.h"

namespace tachless::reference::trajectory {

/// Waypoints from a table, which stays a file: a scenario, its messages and its logs name it with a
/// digest of its bytes. Whoever reads the scenario's file reads the table too
/// (experiment/motion_file.h); who has the scenario from a log or a message has no motion.
struct MotionFile {
  std::string path;
  std::string digest;
  std::shared_ptr<const WaypointSpline> motion;  ///< null where the file was not read

  static constexpr std::string_view name = "file";
  static constexpr std::tuple keys{
      schema::Key{"path", &MotionFile::path, "",
                  "Table of times and positions, relative to the scenario (docs/trajectories.md); "
                  "`file: motion.csv` is short for `file: {path: motion.csv}`"},
      schema::Key{"digest", &MotionFile::digest, "",
                  "Of the table's bytes: another table is refused"}
          .by_default("that of the table found")};

  struct Shape {
    std::shared_ptr<const WaypointSpline> motion;

    /// @throw std::invalid_argument where the file was not read
    explicit Shape(const MotionFile& file) : motion(file.motion) {
      if (motion == nullptr) {
        throw std::invalid_argument("the table " + file.path +
                                    " is not in the log or message that names it");
      }
    }
    [[nodiscard]] loop::ReferencePoint at(double t_s) const { return motion->at(t_s); }
  };
};

}  // namespace tachless::reference::trajectory
