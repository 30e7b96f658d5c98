#pragma once

#include <chrono>
#include <string_view>

#include "launch/progress.h"

namespace tachless::launch {

/// The progress line of a run on stderr, and other lines between.
class Screen {
 public:
  explicit Screen(bool quiet);

  /// On a terminal ten times a second, elsewhere a line every 5 s.
  void show(const Progress& progress);
  void clear();
  /// A line of the program `name`.
  void pass_on(std::string_view name, std::string_view line);

 private:
  using Clock = std::chrono::steady_clock;

  bool quiet_;
  bool terminal_;
  bool shown_ = false;
  Clock::time_point next_{};
};

}  // namespace tachless::launch
