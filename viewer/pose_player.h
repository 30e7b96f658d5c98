#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <deque>
#include <optional>

#include "diagnostics/time.h"
#include "loop/clock.h"
#include "robot/quantities.h"

namespace tachless::viewer {

/// Poses come as fast as a run goes, and leave at the simulated pace: a second for a second. A run
/// that is faster than the wall clock is shown to its end after it is over. For one that is slower,
/// the player waits at first until, at the speed it has seen, the poses will not run out before the
/// end, but no longer than `longest_wait`; should they run out, it shows them as they come.
class PosePlayer {
  using Time = loop::Clock::time_point;

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
  void add(double t_s, const robot::Vector& q, Time now) {
    if (!first_at_) {
      first_at_ = now;
      first_s_ = shown_s_ = t_s;
    } else if (t_s <= poses_.back().t_s) {
      return;
    }
    // The newest makes way for one that is still close to the one before it.
    const std::size_t size = poses_.size();
    if (size >= 2 && t_s - poses_[size - 2].t_s <= interval_s) poses_.pop_back();
    poses_.push_back({t_s, q});
    if (poses_.size() > max_waiting) {
      poses_.pop_front();
      shown_s_ = std::max(shown_s_, poses_.front().t_s);
    }
  }

  /// No more will come, whatever the time of the newest.
  void end() { ended_ = true; }

  /// What to show at `now`: interpolated between the two poses around. Nothing before the first.
  std::optional<Pose> at(Time now) {
    if (poses_.empty()) return std::nullopt;
    if (shown_at_) {
      shown_s_ = std::min(shown_s_ + diagnostics::seconds_of(now - *shown_at_), poses_.back().t_s);
      shown_at_ = now;
    } else if (may_begin(now)) {
      shown_at_ = now;
    }
    while (poses_.size() >= 2 && poses_[1].t_s <= shown_s_) poses_.pop_front();
    const Pose& before = poses_.front();
    if (poses_.size() == 1 || shown_s_ <= before.t_s) return before;
    const Pose& after = poses_[1];
    const double share = (shown_s_ - before.t_s) / (after.t_s - before.t_s);
    return Pose{shown_s_, before.q + share * (after.q - before.q)};
  }

  /// Poses that are kept.
  [[nodiscard]] std::size_t waiting() const { return poses_.size(); }

  /// Whether all there will ever be has been shown.
  [[nodiscard]] bool finished() const {
    return complete() && (poses_.empty() || (shown_at_ && shown_s_ >= poses_.back().t_s));
  }

 private:
  [[nodiscard]] bool complete() const {
    return ended_ || (!poses_.empty() && poses_.back().t_s >= end_s_);
  }

  [[nodiscard]] bool may_begin(Time now) const {
    const loop::Clock::duration waited = now - *first_at_;
    if (complete() || waited >= longest_wait) return true;
    if (waited < shortest_wait) return false;
    // The rest comes within the time that it takes to show everything.
    const double speed = (poses_.back().t_s - first_s_) / diagnostics::seconds_of(waited);
    return end_s_ - poses_.back().t_s <= speed * (end_s_ - first_s_);
  }

  double end_s_;
  bool ended_ = false;
  std::deque<Pose> poses_;  // from the one before what is shown
  std::optional<Time> first_at_;
  double first_s_ = 0;
  std::optional<Time> shown_at_;
  double shown_s_ = 0;
};

}  // namespace tachless::viewer
