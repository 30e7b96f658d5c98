#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tachless::study {

struct Point {
  double x = 0, y = 0;
  bool operator==(const Point&) const = default;
};

/// A curve of any length in at most `max_points` points, such that every peak survives: where
/// samples are many, each stretch of equally many samples is represented by its lowest and its
/// highest sample. Memory does not grow with the curve.
class Envelope {
 public:
  static constexpr std::size_t max_points = 4000;

  /// @param x not below that of the sample before
  void add(double x, double y);

  /// In the order of the samples; at most `at_most` of them (or 2), by wider stretches.
  [[nodiscard]] std::vector<Point> points(std::size_t at_most = max_points) const;

 private:
  struct Bin {
    Point low, high;
  };
  static Bin merge(const Bin& a, const Bin& b);
  static void halve(std::vector<Bin>& bins);

  std::vector<Bin> bins_;
  std::int64_t samples_per_bin_ = 1;
  std::int64_t samples_in_last_ = 0;
};

}  // namespace tachless::study
