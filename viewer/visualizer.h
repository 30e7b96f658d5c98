#pragma once

namespace tachless::viewer {

/// What tachless-visualizer writes to stdout, as a line, once its window is open and it hears the
/// bus.
inline constexpr const char* window_is_open = "the window is open";

/// The program tachless-visualizer: the robot of a run, moving, in Simbody's window. Listens to the
/// bus and says nothing there. Ends with 0 when it has shown the whole run or the window was
/// closed. SIGUSR1 tells it that the run is over, wherever it stopped.
int visualizer(int argc, const char* const* argv);

}  // namespace tachless::viewer
