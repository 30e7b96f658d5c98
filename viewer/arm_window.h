#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "robot/model.h"
#include "robot/quantities.h"
#include "viewer/visuals.h"

namespace tachless::viewer {

/// Simbody's 3D window of a robot in a given pose. Knows no bus, no time but what it is told, and
/// no dynamics. A body is what its visuals show; one without, or of which one cannot be drawn, is
/// cylinders between the joints' frames.
///
/// The window belongs to a child process, simbody-visualizer. Simbody does not notice its end:
/// while the constructor runs it then waits for good, and later it fills a pipe that nobody
/// empties. Whoever opens a window looks after SIGCHLD.
class ArmWindow {
 public:
  /// What there is to say when that process ends while the window is being opened.
  static constexpr const char* viewer_ended =
      "Simbody's window cannot be opened: simbody-visualizer ended at once; does this display have "
      "OpenGL? As root, type: apt-get install libgl1-mesa-dri";

  /// Opens the window. Needs a display with OpenGL. The view fits the robot as it is at `initial`.
  /// @param model outlives this
  /// @param tools links whose frames are drawn: x red, y green, z blue
  /// @param viewers folder with simbody-visualizer, and the same as simbody-visualizer_d
  /// @throw diagnostics::Failure(bad_usage) saying what is missing
  ArmWindow(const robot::Model& model, const Visuals& visuals,
            const std::vector<std::string>& tools, const robot::Vector& initial,
            const std::string& title, const std::filesystem::path& viewers);
  ArmWindow(const ArmWindow&) = delete;
  ArmWindow& operator=(const ArmWindow&) = delete;
  /// Closes it.
  ~ArmWindow();

  /// Draws the robot with its links at `q` [rad; m], and the simulated time [s].
  /// @throw diagnostics::Failure(bad_usage) when it cannot be drawn
  void show(double t_s, const robot::Vector& q);

 private:
  struct Window;
  std::unique_ptr<Window> window_;
};

}  // namespace tachless::viewer
