#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/clock.h"

namespace tachless::plant {

/// Comparison of a driver's own time with this computer's clock, over windows of at least 20 ms.
/// Speeds are computed with the driver's time, so a wrong unit would hide them.
class ClockRate {
 public:
  using Time = base::Clock::time_point;
  static constexpr double factor = 2;         ///< largest allowed ratio of the two times
  static constexpr double window_s = 0.02;    ///< shortest window
  static constexpr int periods_a_window = 4;  ///< fewest; the driver's time may be a tick old

  /// @param longest_stall_s longest time for which this process may stand still [s]
  ClockRate(double period_s, double longest_stall_s)
      : period_s_(period_s), longest_stall_s_(longest_stall_s) {}

  /// The result of one window.
  struct Window {
    bool sound = false;  ///< within `factor`
    double rate = 0;     ///< the driver's time over this computer's
  };

  /// Takes a reading of the driver's time, with the times at which it was asked for and had
  /// arrived. A driver that hands over readings one by one is late after a stall of this process,
  /// and then catches up. This is no wrong rate.
  /// @return the window that ends here, if one does
  std::optional<Window> add(double own_s, Time asked, Time there) {
    if (!std::isfinite(own_s)) {
      mark_.reset();
      return std::nullopt;
    }
    if (!mark_) {
      begin_ = asked;
      ahead_s_ = own_s;
      set_mark(own_s, asked, there);
      last_asked_ = asked;
      return std::nullopt;
    }
    const double gap_s = base::seconds_of(asked - last_asked_);
    stalled_s_ += std::max(0.0, gap_s - period_s_);
    last_asked_ = asked;
    ahead_s_ = std::max(ahead_s_, own_s - base::seconds_of(there - begin_));
    const double shortest_s = base::seconds_of(asked - mark_->there);
    if (shortest_s < std::max(window_s, periods_a_window * period_s_)) return std::nullopt;
    const double own = own_s - mark_->own_s;
    const double longest_s = base::seconds_of(there - mark_->asked);
    const Window window{
        own <= factor * longest_s + mark_->late_s && own >= (shortest_s - stalled_s_) / factor,
        own / longest_s};
    set_mark(own_s, asked, there);
    return window;
  }

 private:
  struct Mark {
    double own_s = 0;
    Time asked, there;
    double late_s = 0;  ///< largest age of this reading beyond the age of the newest one
  };

  void set_mark(double own_s, Time asked, Time there) {
    const double late_s = ahead_s_ - (own_s - base::seconds_of(there - begin_));
    mark_ = {own_s, asked, there, std::clamp(late_s, 0.0, longest_stall_s_)};
    stalled_s_ = 0;
  }

  double period_s_, longest_stall_s_;
  std::optional<Mark> mark_;  ///< beginning of the window
  Time begin_, last_asked_;
  double ahead_s_ = 0;    ///< the driver's time at `begin_` by the freshest reading
  double stalled_s_ = 0;  ///< time in the window in which this process stood still
};

}  // namespace tachless::plant
