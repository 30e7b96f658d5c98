#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace tachless::launch {

/// What a running loop looks like in one line, from the controller's heartbeats:
/// "0.842 of 2 s  [========>           ]  9.3 k ticks/s  |e| 3.2e-04 rad". Prints nothing itself.
class Progress {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param robot stands before it; empty: nothing does
  Progress(std::int64_t num_ticks, double period_s, const std::string& robot = "");

  /// The controller has handled tick `tick` (-1: none yet).
  void note(std::int64_t tick, double error_norm, Clock::time_point now);

  [[nodiscard]] std::string line() const;

 private:
  std::int64_t num_ticks_;
  double period_s_;
  std::string before_;
  std::int64_t tick_ = -1;
  double error_norm_ = 0;
  struct Sample {
    std::int64_t tick;
    Clock::time_point at;
  };
  std::optional<Sample> rate_from_;
  std::optional<double> ticks_per_s_;
};

}  // namespace tachless::launch
