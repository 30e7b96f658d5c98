#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "in_process/in_process_loop.h"
#include "scenario/scenario.h"
#include "study/verdict.h"

/// Measures by which runs are compared. The loop runs in this process, and no file is written.
namespace tachless::study {

/// Error beyond which a run is broken off as diverging [rad; m].
inline constexpr double diverged_error = 100;

/// Measures of a run. Errors are |q - q_ref| and torques |tau|, Euclidean norms over the joints.
struct Measures {
  Verdict verdict;
  std::int64_t ticks = 0;       ///< stepped
  double peak_error = 0;        ///< [rad; m]
  double rms_error = 0;         ///< [rad; m]
  double settled_error = 0;     ///< root mean square over the last quarter of the run [rad; m]
  double torque_rms = 0;        ///< applied [N m; N]
  double torque_variation = 0;  ///< sum of |tau_k - tau_(k-1)| over the run's length [N m/s]
  double energy = 0;            ///< sum over the joints of the integral of |tau v| [J]
  /// Root mean square of the law's velocity estimate less the velocity, over the last quarter of
  /// the run [rad/s; m/s]. The estimate is v_hat or v_ref + nu. NaN for a law that has neither.
  double velocity_error = 0;

  // A comparison of laws has the members below too. They are NaN where they were not computed.
  /// Root mean square, over ticks and joints, of the torque that counts and noise of the sensors
  /// add [N m; N]. NaN with exact sensors, and when the run was broken off.
  double torque_noise = NAN;
  double largest_period_s = NAN;  ///< largest period at which the linearised loop is stable [s]
};

/// A number of `Measures` by name, for tables and figures.
struct MeasureColumn {
  std::string_view name, unit;
  double (*value)(const Measures&);
};
/// Returns the column's unit on a robot with these joints: "rad", "m", or both for both kinds.
std::string unit_of(const MeasureColumn& column, const robot::JointLabels& joints);
/// Returns the columns.
/// @param comparison adds the columns of a comparison of laws, at the end
std::span<const MeasureColumn> measure_columns(bool comparison = false);

/// Returns `Measures::torque_noise` of the scenario from two runs, with its sensors and with exact
/// sensors.
double torque_noise(const scenario::Scenario& scenario);

/// Runs the scenario. An end by a protective stop is a result. An error beyond 100 rad or m is a
/// result too: the run is broken off as diverging.
/// @param on_tick called with each tick; nothing is returned once it returns false
/// @throw base::Failure(bad_usage) for an inconsistent scenario.
std::optional<Measures> measure(
    const scenario::Scenario& scenario,
    const std::function<bool(const in_process::TickRecord&)>& on_tick = {});

}  // namespace tachless::study
