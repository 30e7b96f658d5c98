#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/file_descriptor.h"

/// Progress of runs and long computations, in lines on stderr.
namespace tachless::cli {

/// A line that shows a running loop, made from the controller's heartbeats:
/// "0.842 of 2 s  [========>           ]  9.3 k ticks/s  |e| 3.2e-04 rad". It prints nothing.
class Progress {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param unit of the norm of the position error
  /// @param robot stands at the beginning of the line, unless it is empty
  Progress(std::int64_t num_ticks, double period_s, std::string unit = "rad",
           const std::string& robot = "");

  /// Records that the controller has handled tick `tick` (-1: none yet).
  void note(std::int64_t tick, double error_norm, Clock::time_point now);

  [[nodiscard]] std::string line() const;

 private:
  std::int64_t num_ticks_;
  double period_s_;
  std::string unit_;
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

/// Text to stderr that does not wait for a slow reader. A bounded buffer holds the text that does
/// not fit into the pipe or the terminal. Text that does not fit into the buffer is dropped and
/// counted.
class LaggingOutput {
 public:
  explicit LaggingOutput(int descriptor);
  LaggingOutput(const LaggingOutput&) = delete;
  LaggingOutput& operator=(const LaggingOutput&) = delete;
  /// Writes the rest, and waits for its reader.
  ~LaggingOutput();

  void put(std::string_view text);
  /// Writes as much as is possible now.
  /// @return whether something is left
  bool flush();

 private:
  int descriptor_;
  base::FileDescriptor
      own_;  ///< the same file, opened for writes that do not wait; -1: not possible
  std::string waiting_;
  std::int64_t dropped_ = 0;  ///< number of dropped texts
};

/// Lines of progress, and other lines between them. On a terminal each line of progress replaces
/// the line before, and the last line is removed. Elsewhere at most one appears in 30 s.
class Screen {
 public:
  /// @param quiet no progress
  explicit Screen(bool quiet);
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;
  ~Screen() { clear(); }

  /// Shows the progress of a long computation.
  void show(std::string_view what);
  /// Shows a line for each run. A terminal gets new lines ten times a second.
  void show(std::span<const Progress> all);
  void clear();
  /// Prints a line of the program `name`.
  /// @param before the robot, where there are several
  void pass_on(std::string_view before, std::string_view name, std::string_view line);

 private:
  /// Returns the characters that remove the shown lines from the terminal.
  std::string erasing();

  LaggingOutput out_;
  bool quiet_;
  bool terminal_;
  std::size_t shown_ = 0;  ///< lines on the terminal
  Progress::Clock::time_point next_{};
};

}  // namespace tachless::cli
