#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>

#include "linear/frequencies.h"
#include "linear/linear_loop.h"

/// Stability, margins and motion of a law's linearised loop at a fixed period. The map of one
/// period is exact for the linearised loop. Large errors, saturation and quantisation are not
/// covered. A moving reference needs `radius_along`, because stable eigenvalues at frozen postures
/// are neither necessary nor sufficient.
namespace tachless::linear {

/// A plant and the law for any period.
struct SampledLoop {
  LinearPlant plant;
  std::function<LinearLaw(double period_s)> law;
  int delay = 0;  ///< whole periods from measurement to torque
};

/// Returns the loop at `period_s`, cut at the law's feedback terms.
CutLoop cut(const SampledLoop& loop, double period_s);

/// Returns the spectral radius of the map of one period.
double radius_at(const SampledLoop& loop, double period_s);

/// Range of the periods that are tried [s].
inline constexpr double shortest_s = 1e-7, longest_s = 1;
/// Returns the stability limit nearest to `from_s` that was found [s]. The limit is above `from_s`
/// if the loop is stable at `from_s`, else below. Periods are tried in steps of 2 %, and between
/// them where the radius has a maximum. A narrower interval of unstable periods may be missed.
/// Returns at least `longest_s`, or `from_s` beyond that, when no unstable period was found.
/// Returns nothing when the loop is unstable even at `shortest_s`, and therefore in continuous
/// time.
std::optional<double> largest_stable_period(const SampledLoop& loop, double from_s = shortest_s);

/// Motion of the loop at one period.
struct Modes {
  bool stable = false;
  double radius = 0;       ///< spectral radius of the one-period map
  double decay_per_s = 0;  ///< decay of the slowest mode [1/s]
  /// Time until the errors of all joints stay below 1 % of an error that began in one joint alone,
  /// at rest [s]. `settling_s` is the longest of all joints, `settling_mean_s` the mean.
  double settling_s = 0, settling_mean_s = 0;
  double least_damped_hz = 0;
  double least_damping = 1;  ///< 1: no mode oscillates
};
Modes modes(const SampledLoop& loop, double period_s);

/// Margins of the loop broken at the law's feedback terms, all joints at once. The law's
/// compensation of gravity by the model stays closed (LinearLaw::compensation), since no gain
/// multiplies it.
struct Margins {
  /// Least distance of L's eigenvalues from -1 over all frequencies: the margin against one factor,
  /// lag or delay common to all joints.
  double modulus = 0;
  /// Least singular value of 1 + L: the size of the smallest errors that may make the loop
  /// unstable. The errors are independent in all joints, in units of torque.
  double modulus_independent = 0;
  /// Factor above 1 on all joints that makes the loop unstable; infinite: none up to 1e4.
  double gain = 0;
  /// Factor below 1 on all joints that makes the loop unstable, as with an integral; 0 where none
  /// was found down to 0.01.
  double least_gain = 0;
  double phase_deg = 0;  ///< lag common to all joints that makes the loop unstable; 180: none does
  /// Delay common to all joints that makes the loop unstable; infinite: none does.
  double delay_s = 0;
};
/// Returns `Margins::modulus` alone; 0 for an unstable loop.
double modulus_margin(const SampledLoop& loop, double period_s);
/// Returns the margins of a stable loop; all zero for an unstable one.
Margins margins(const SampledLoop& loop, double period_s);

/// Returns the torque on the links per position error at rest, of all joints together. Gravity
/// counts as compensated, and the growth of an integral is left out.
/// @param scale torque that acts over the commanded torque, per joint
/// @param springs stiffness of flexible joints; empty: rigid joints
Eigen::MatrixXd stiffness_at_rest(LinearLaw law, const Eigen::VectorXd& scale,
                                  const Eigen::VectorXd& springs, double period_s);

/// Returns the spectral radius per period along a motion that repeats after `ticks` periods. It is
/// the root of degree `ticks` of the radius of the product of the one-period maps. `map_at(k)`
/// leads from tick k to k + 1.
double radius_along(const std::function<Eigen::MatrixXd(int)>& map_at, int ticks);

}  // namespace tachless::linear
