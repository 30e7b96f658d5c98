#pragma once

#include <optional>

#include "launch/run_plan.h"
#include "launch/screen.h"
#include "process/side_process.h"

namespace tachless::launch {

/// Simbody's 3D window beside a run. Closing it is reported but does not stop the run.
class RunWindow {
 public:
  /// @throw diagnostics::Failure(bad_usage) when none can be opened
  RunWindow(const RunOptions& options, bool isolated, Screen& screen);

  /// Passes on what it has said, and tells when it is gone.
  void attend();

  /// The run is over: what is left to show will be shown.
  void run_is_over(bool interrupted);

  /// Waits until the window has shown everything, is closed, or the user interrupts.
  void finish();

 private:
  const RunOptions& options_;
  Screen& screen_;
  std::optional<process::SideProcess> program_;
};

}  // namespace tachless::launch
