#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/quantities.h"
#include "base/schema.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "study/tracking.h"

/// What a run came to, in one word: judged afterwards by its signals, whatever was predicted. Steps
/// nothing. docs/report.md says what the words mean.
namespace tachless::study {

/// From the best to the worst.
enum class Outcome {
  converged,     ///< the last quarter's error is at most 1 % of the joint's scale, or 3 counts
  followed,      ///< at most 5 %
  lags,          ///< more, and the motion or a disturbance makes it, or dry friction
  slow,          ///< more, and it decays
  not_judged,    ///< too few ticks, or a dry run
  rests_beside,  ///< more, and it is constant
  stuck,         ///< more, and dry friction holds the joint at most times
  saturated,     ///< a joint was at its torque limit for more than half of the run
  limit_cycle,   ///< the error swings, without decaying, faster than asked for or beyond its scale
  diverging,     ///< the error grows
  outside,       ///< it started beyond the error at which a run is broken off
  interrupted,   ///< by the user
  stopped,       ///< by a protective stop, or a program that ended early
};
constexpr std::array<std::string_view, 13> names(Outcome /*type*/) {
  return {"converged",    "followed",    "lags",      "slow",        "not_judged",
          "rests_beside", "stuck",       "saturated", "limit_cycle", "diverging",
          "outside",      "interrupted", "stopped"};
}

/// Whether the measures of a run that ended so mean nothing.
constexpr bool broken_off(Outcome outcome) { return outcome >= Outcome::diverging; }
/// Whether a run that ended so is a failure: exit code 1.
constexpr bool bad(Outcome outcome) { return outcome >= Outcome::rests_beside; }

/// What a run is judged by besides its signals. Of the vectors each may be empty: nothing is known.
struct Yardsticks {
  Vector resolution{};  ///< of each joint's encoder: one count, or its noise [rad; m]
  Vector friction{};    ///< largest dry friction [N m; N]
  Vector stiffness{};   ///< torque per position error at rest, kp [N m/rad; N/m]
  std::vector<double> saturated_share{};  ///< of the ticks, per joint
  bool realtime = false;                  ///< late and missed commands make it swing too
};

/// What the scenario says of it: all but the saturated share and the stiffness, which only the
/// verdict's text is about.
Yardsticks yardsticks(const scenario::Scenario& scenario);

struct Verdict {
  Outcome outcome = Outcome::not_judged;
  std::size_t joint = 0;       ///< the one that decides
  double error = 0;            ///< its largest |e| in the last quarter of the run [rad; m]
  double share = 0;            ///< of its scale; NaN where it has none
  double frequency_hz = 0;     ///< of a limit cycle, at least
  double settled_s = 0;        ///< when every joint's error was within 1 % of its scale for good
  double counted_from_s = 0;   ///< that is counted from the motion's end; 0: from the start
  bool moves = false;          ///< the reference does
  double saturated_share = 0;  ///< largest of the joints' shares of ticks
  double friction = 0, stiffness = 0;  ///< of the joint that decides, where known
  std::string reason;                  ///< why it was stopped, interrupted, not judged

  [[nodiscard]] std::string_view word() const { return base::name_of(outcome); }
};

/// From when on the reference rests; 0 when it never moves, or does so until the end.
double rests_from_s(const std::vector<Point>& q_ref);

/// A joint's scale is the largest of the extent of its reference and its initial error; that of one
/// which has neither, or less than its noise or a thousandth of the largest, is the largest of all
/// joints' scales, and where none has any, its largest error.
Verdict judge(const Tracking& tracking, const Yardsticks& yardsticks);

/// "converged, settled within 0.21 s", "stuck: joint 2 (elbow) rests 0.03 rad beside …", …
std::string text(const Verdict& verdict, const robot::JointLabels& joints);

}  // namespace tachless::study
