#pragma once

namespace tachless::viewer {

/// What tachless-visualizer writes to stdout, as a line, once its window is open and it hears the
/// bus. (The program itself is viewer/visualizer.cpp.)
inline constexpr const char* window_is_open = "the window is open";

}  // namespace tachless::viewer
