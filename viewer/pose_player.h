#pragma once

#include <cstddef>
#include <deque>
#include <optional>

#include "loop/clock.h"
#include "robot/quantities.h"

namespace tachless::viewer {

/// Poses come as fast as a run goes, and leave at the simulated pace: a second for a second. A run
/// that is faster than the wall clock is shown to its end after it is over. For one that is slower,
/// the player waits at first until, at the speed it has seen, the poses will not run out before the
/// end, but no longer than `longest_wait`; should they run out, it shows them as they come.
class PosePlayer {
 public:
  /// Poses closer together [s of simulated time] than this are passed over, but for the newest.
  static constexpr double interval_s = 1.0 / 30;
  /// Most poses that wait (an hour's); then the oldest are left out.
  static constexpr std::size_t max_waiting = 108'000;
  /// No speed is seen in less.
  static constexpr loop::Clock::duration shortest_wait = std::chrono::milliseconds(200);
  static constexpr loop::Clock::duration longest_wait = std::chrono::seconds(3);

  struct Pose {
    double t_s = 0;  ///< simulated time
    robot::Vector q;
  };

  /// @param end_s simulated time of the run's last pose, if nothing goes wrong
  explicit PosePlayer(double end_s) : end_s_(end_s) {}

  /// Poses in order of time; one that is not newer than the newest is passed over.
  void add(double t_s, const robot::Vector& q, loop::Clock::time_point now);
  /// No more will come, whatever the time of the newest.
  void end() { ended_ = true; }

  /// What to show at `now`: interpolated between the two poses around. Nothing before the first.
  std::optional<Pose> at(loop::Clock::time_point now);

  /// Poses that are kept.
  [[nodiscard]] std::size_t waiting() const { return poses_.size(); }

  /// Whether all there will ever be has been shown.
  [[nodiscard]] bool finished() const;

 private:
  [[nodiscard]] bool complete() const;
  [[nodiscard]] bool may_begin(loop::Clock::time_point now) const;

  double end_s_;
  bool ended_ = false;
  std::deque<Pose> poses_;  // from the one before what is shown
  std::optional<loop::Clock::time_point> first_at_;
  double first_s_ = 0;
  std::optional<loop::Clock::time_point> shown_at_;
  double shown_s_ = 0;
};

}  // namespace tachless::viewer
