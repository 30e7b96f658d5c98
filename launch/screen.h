#pragma once

#include <chrono>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "launch/progress.h"

namespace tachless::launch {

/// Progress on stderr, a line for each run, and other lines between.
class Screen {
 public:
  explicit Screen(bool quiet);

  /// On a terminal ten times a second, elsewhere a line every 5 s.
  void show(std::span<const Progress> all);
  void clear();
  /// A line of the program `name`.
  /// @param before what stands before it: of which robot's run it is
  void pass_on(std::string_view before, std::string_view name, std::string_view line);

 private:
  /// What removes from the terminal what is shown.
  std::string erasing();

  using Clock = std::chrono::steady_clock;

  bool quiet_;
  bool terminal_;
  std::size_t shown_ = 0;  ///< lines on the terminal
  Clock::time_point next_{};
};

}  // namespace tachless::launch
