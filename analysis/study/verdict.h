#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "base/quantities.h"
#include "base/schema.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "study/tracking.h"

/// The verdict on a run, in one of seven words. The verdict is based on the run's signals. Numbers
/// of the linearised loop distinguish noise and a slow decay from faults. docs/report.md explains
/// the words.
namespace tachless::study {

/// Words from the best to the worst.
enum class Outcome {
  converged,     ///< error at most 1 % of the joint's scale, or within counts and noise
  lags,          ///< larger error, which the motion or a disturbance causes, or which still settles
  not_judged,    ///< no verdict: too few ticks, or a dry run
  rests_beside,  ///< larger error that stays: friction or an unknown torque holds the joint
  saturated,     ///< a joint was at its torque limit for more than half of the run
  oscillates,    ///< the error swings without decaying, and neither reference nor noise makes it
  diverging,     ///< the error grows
  stopped,       ///< by the user, a protective stop, or a program that ended early
};
constexpr std::array<std::string_view, 8> names(Outcome /*type*/) {
  return {"converged", "lags",       "not_judged", "rests_beside",
          "saturated", "oscillates", "diverging",  "stopped"};
}

/// Returns true if the measures of a run with this outcome mean nothing.
constexpr bool broken_off(Outcome outcome) { return outcome >= Outcome::diverging; }
/// Returns true if a run with this outcome is a failure: exit code 1.
constexpr bool bad(Outcome outcome) { return outcome >= Outcome::rests_beside; }

/// Numbers of the linearised loop at rest.
struct LoopYardstick {
  bool stable = false;    ///< false: unstable or unknown, and the rest is empty
  Vector noise{};         ///< standard deviation of each joint's error by its encoders [rad; m]
  double settling_s = 0;  ///< time until an initial error is below 1 %
};

/// Facts beside the signals that a verdict needs. An empty vector means that nothing is known.
struct Yardsticks {
  Vector resolution{};  ///< one count of each joint's encoder, or the encoder's noise [rad; m]
  Vector friction{};    ///< largest dry friction [N m; N]
  Vector stiffness{};   ///< torque per position error at rest, kp [N m/rad; N/m]
  /// Share of the ticks in which the joint was at its torque limit.
  std::vector<double> saturated_share{};
  bool realtime = false;  ///< late and missed commands make the error swing too
  bool held = true;       ///< the scenario's reference is a constant position
  double period_s = 0;    ///< period of the reference; 0: the reference does not repeat
  /// Returns true if a disturbance varies between the two times [s]. Empty: never.
  std::function<bool(double from_s, double to_s)> disturbed{};
  /// Returns the loop's numbers at these postures. Empty: nothing is known.
  std::function<LoopYardstick(const std::vector<Vector>& postures)> loop{};
};

/// Returns the facts that the scenario gives. Leaves the saturated share, the stiffness and the
/// loop empty.
Yardsticks yardsticks(const scenario::Scenario& scenario);

/// Cause of an error whose outcome is `lags` or `rests_beside`.
enum class Cause { unknown, motion, disturbance, settling, friction };

/// Verdict on a run, with the numbers that its text shows.
struct Verdict {
  Outcome outcome = Outcome::not_judged;
  Cause cause = Cause::unknown;
  std::size_t joint = 0;    ///< the worst one
  double error = 0;         ///< largest |e| of that joint in the last quarter of the run [rad; m]
  double share = 0;         ///< `error` over the joint's scale; not finite without a scale
  double frequency_hz = 0;  ///< lower bound of an oscillation's frequency
  double settled_s = 0;     ///< last time at which some joint's error exceeded 1 % of its scale [s]
  double counted_from_s = 0;   ///< end of the motion, where settled_s is 0; 0: start of the run
  double loop_settles_s = 0;   ///< settling time of the linearised loop; 0: unknown
  double rested_s = 0;         ///< time from the end of all motion to the end of the run
  bool moves = false;          ///< the reference moves
  bool held = true;            ///< the scenario's reference is a constant position
  double saturated_share = 0;  ///< largest of the joints' shares of ticks
  /// Dry friction and stiffness of the worst joint; 0: unknown.
  double friction = 0, stiffness = 0;
  std::string reason;  ///< why the run was stopped or not judged

  [[nodiscard]] std::string_view word() const { return base::name_of(outcome); }
};

/// Returns when the reference comes to rest; 0 if it never moves, or moves until the end.
double rests_from_s(const std::vector<Point>& q_ref);

/// Judges a run. A joint's scale is the larger of the extent of its reference and its initial
/// error. A scale below the joint's noise, or below a thousandth of the largest scale, is replaced
/// by the largest scale. If no joint has a scale, each joint's largest error replaces it.
Verdict judge(const Tracking& tracking, const Yardsticks& yardsticks);

/// Returns a sentence: "converged, settled within 0.21 s", "rests beside: joint 2 (elbow) …".
std::string text(const Verdict& verdict, const robot::JointLabels& joints);

}  // namespace tachless::study
