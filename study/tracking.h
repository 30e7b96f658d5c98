#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "robot/model.h"
#include "robot/quantities.h"
#include "schema/schema.h"
#include "study/envelope.h"

/// What a run did, from its signals, and how it is judged by its errors and torques alone:
/// afterwards, whatever was predicted. Steps nothing.
namespace tachless::study {

/// Peak, root mean square and last value of a signal.
class Extent {
 public:
  void add(double value);

  [[nodiscard]] double peak() const { return peak_; }  ///< of the absolute value
  [[nodiscard]] double rms() const;
  [[nodiscard]] double final() const { return final_; }

 private:
  double peak_ = 0;
  double sum_of_squares_ = 0;
  double final_ = 0;
  std::int64_t count_ = 0;
};

/// How well one joint followed its reference.
struct JointTracking {
  Extent error;   ///< q - q_ref [rad; m if prismatic]
  Extent torque;  ///< applied [N m; N if prismatic]
  Envelope q, q_ref, theta, abs_error, tau;
  Envelope error_over_time;  ///< signed
};

/// What the closing table, the summary and the figure say about a run, gathered tick by tick.
class Tracking {
 public:
  explicit Tracking(int num_joints);

  /// One tick at time `t_s`. `theta` is empty on a robot with rigid joints.
  /// @param tau torque applied over the tick
  void add(double t_s, const robot::Vector& q, const robot::Vector& q_ref,
           const robot::Vector& theta, const robot::Vector& tau);

  [[nodiscard]] const std::vector<JointTracking>& joints() const { return joints_; }
  [[nodiscard]] std::int64_t num_ticks() const { return num_ticks_; }
  [[nodiscard]] bool has_motors() const { return has_motors_; }

 private:
  std::vector<JointTracking> joints_;
  std::int64_t num_ticks_ = 0;
  bool has_motors_ = false;
};

enum class Outcome {
  converged,    ///< the error fell below 1 % of its peak and stayed there
  followed,     ///< neither, and none of those below: a slow decay, an error that the motion makes
  saturated,    ///< a joint was at its torque limit for more than half of the run
  limit_cycle,  ///< the error swings, without decaying, faster than the reference asks for
  diverging,    ///< the error grows
  not_judged,   ///< too few ticks
};
constexpr std::array<std::string_view, 6> names(Outcome /*type*/) {
  return {"converged", "followed", "saturated", "limit_cycle", "diverging", "not_judged"};
}

struct Observed {
  Outcome outcome = Outcome::not_judged;
  std::size_t joint = 0;       ///< the one that decides, of the last four
  double amplitude = 0;        ///< largest |e| in the last quarter of the run, of that joint
  double frequency_hz = 0;     ///< of a limit cycle, at least
  double settled_s = 0;        ///< of `converged`: when the error was last above 1 % of its peak
  double saturated_share = 0;  ///< largest of the joints' shares of ticks

  /// Whether a run that ended so is a failure.
  [[nodiscard]] bool bad() const;
};

/// @param saturated_ticks per joint; may be empty
Observed observe(const Tracking& tracking, const std::vector<std::int64_t>& saturated_ticks);

/// "converged, settled within 0.21 s", "limit cycle: joint 2 swings by 0.03 rad at 61 Hz", …
std::string text(const Observed& observed, const robot::JointLabels& joints);

}  // namespace tachless::study
