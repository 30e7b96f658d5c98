#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <vector>

namespace tachless::node {

/// Durations in buckets of a fixed relative width (16 an octave, so 6 %): constant memory, `add`
/// allocates nothing. Knows no unit of the loop and no file.
class LatencyHistogram {
 public:
  struct Bucket {
    double from_us = 0;
    std::int64_t count = 0;
  };

  void add(std::chrono::nanoseconds duration);
  /// Restores what `buckets` and `max_us` of another histogram have told.
  void add(const Bucket& bucket);
  void raise_max(double max_us);

  [[nodiscard]] std::int64_t count() const { return count_; }
  [[nodiscard]] double max_us() const;

  /// The duration that the given part (0 to 1) of all do not exceed, to a bucket's width [us];
  /// 0 when there is none.
  [[nodiscard]] double percentile_us(double part) const;

  /// The buckets that hold anything, in order.
  [[nodiscard]] std::vector<Bucket> buckets() const;

 private:
  static constexpr int per_octave = 16;
  static constexpr int num_buckets = per_octave * 36;  // up to more than a minute in ns
  static int bucket_of(std::int64_t ns);
  static std::int64_t lower_edge(int bucket);

  std::array<std::int64_t, num_buckets> counts_{};
  std::int64_t count_ = 0;
  std::int64_t max_ns_ = 0;
};

}  // namespace tachless::node
