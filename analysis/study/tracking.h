#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/quantities.h"

/// Tracking error and torque of a run, from its signals. Nothing here steps a loop.
namespace tachless::study {

struct Point {
  double x = 0, y = 0;
  bool operator==(const Point&) const = default;
};

/// A curve of any length in at most `max_points` points that keeps every peak. Many samples are
/// divided into stretches of equally many samples. Each stretch is represented by its lowest and
/// its highest sample. Memory does not grow with the curve.
class Envelope {
 public:
  static constexpr std::size_t max_points = 4000;

  /// Adds a sample.
  /// @param x not below the x of the sample before
  void add(double x, double y);

  /// Returns at most max(`at_most`, 2) points in the order of the samples. A smaller `at_most`
  /// makes the stretches longer.
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

/// Peak, root mean square, first and last value of a signal.
class Extent {
 public:
  void add(double value);

  [[nodiscard]] double peak() const { return peak_; }  ///< peak of the absolute value
  [[nodiscard]] double rms() const;
  [[nodiscard]] double first() const { return first_; }
  [[nodiscard]] double final() const { return final_; }

 private:
  double peak_ = 0;
  double sum_of_squares_ = 0;
  double first_ = 0, final_ = 0;
  std::int64_t count_ = 0;
};

/// Tracking of one joint's reference.
struct JointTracking {
  Extent error;   ///< q - q_ref [rad; m if prismatic]
  Extent torque;  ///< applied [N m; N if prismatic]
  Envelope q, q_ref, theta, abs_error, tau;
  Envelope error_over_time;  ///< signed
};

/// Tracking of all joints over a run, gathered tick by tick. The table after a run, its summary and
/// its figure show these numbers.
class Tracking {
 public:
  explicit Tracking(int num_joints);

  /// Adds one tick at time `t_s`. `theta` is empty on a robot with rigid joints.
  /// @param tau torque applied over the tick
  void add(double t_s, const Vector& q, const Vector& q_ref, const Vector& theta,
           const Vector& tau);

  [[nodiscard]] const std::vector<JointTracking>& joints() const { return joints_; }
  [[nodiscard]] std::int64_t num_ticks() const { return num_ticks_; }
  [[nodiscard]] bool has_motors() const { return has_motors_; }

 private:
  std::vector<JointTracking> joints_;
  std::int64_t num_ticks_ = 0;
  bool has_motors_ = false;
};

}  // namespace tachless::study
