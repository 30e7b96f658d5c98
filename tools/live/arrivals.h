#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

namespace tachless::live {

/// Statistics of the times between messages, by Welford's algorithm.
class Arrivals {
 public:
  void add(std::int64_t interval_ns) {
    ++count_;
    const auto interval = static_cast<double>(interval_ns);
    const double before = interval - mean_ns_;
    mean_ns_ += before / static_cast<double>(count_);
    deviations_ns2_ += before * (interval - mean_ns_);
    longest_ns_ = std::max(longest_ns_, interval_ns);
  }

  /// Returns messages per second, or nullopt without an interval above zero.
  [[nodiscard]] std::optional<double> rate_hz() const {
    if (count_ == 0 || !(mean_ns_ > 0)) return std::nullopt;
    return 1e9 / mean_ns_;
  }
  /// Returns the standard deviation of the intervals, or nullopt with fewer than two.
  [[nodiscard]] std::optional<double> jitter_us() const {
    if (count_ < 2) return std::nullopt;
    return 1e6 * (1e-9 * std::sqrt(deviations_ns2_ / (static_cast<double>(count_) - 1)));
  }
  [[nodiscard]] double longest_us() const { return 1e-3 * static_cast<double>(longest_ns_); }
  /// Returns the sum of the intervals.
  [[nodiscard]] double total_ns() const { return mean_ns_ * static_cast<double>(count_); }

 private:
  std::uint64_t count_ = 0;
  double mean_ns_ = 0, deviations_ns2_ = 0;
  std::int64_t longest_ns_ = 0;
};

}  // namespace tachless::live
