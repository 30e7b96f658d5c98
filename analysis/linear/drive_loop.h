#pragma once

#include <Eigen/Core>

#include "base/quantities.h"
#include "linear/linear_loop.h"
#include "linear/sampled_limit.h"
#include "scenario/drive_loop.h"

/// The loop inside the drives (plant.drive.loop) and its margins, by the exact map of one period.
namespace tachless::linear {

/// Returns the plant with the drives' loop closed. `plant.B` includes the drives' `torque_scale`.
/// @param host_period_s period in which `loop.late_ticks` are counted
LinearPlant with_drive_loop(const LinearPlant& plant, const scenario::DriveLoopSpec& loop,
                            double host_period_s);

/// Returns the plant that `with_drive_loop` was given.
LinearPlant without_drive_loop(const LinearPlant& plant);

/// Margins of a stable loop at the drives, while the host's loop is closed.
struct DriveMargins {
  /// Factor above 1 on kp and kd that makes the loop unstable; infinite: none up to 1e4.
  double gain = 0;
  /// Largest further delay that keeps the loop stable, up to `most_drive_ticks` [ticks of the
  /// drives].
  int delay_ticks = 0;
  /// Inverse of the largest singular value, over all frequencies, from torques that are added in
  /// each tick of the drives to the torques that act. All ticks of one period of the host are one
  /// input (a lifted loop).
  double modulus = 0;
};
inline constexpr int most_drive_ticks = 400;

/// Largest delay of the host's torque that `host_delay_margin` tries [periods of the host].
inline constexpr int most_host_ticks = 32;

/// A host's law around drives with a loop of their own, at one posture and period.
struct SplitLoop {
  LinearPlant arm;  ///< without the drives' loop
  scenario::DriveLoopSpec drive;
  LinearLaw law;
  double period_s = 0;
  int delay = 0;  ///< the host's whole periods from measurement to torque

  [[nodiscard]] LinearPlant plant() const { return with_drive_loop(arm, drive, period_s); }
  /// The map of one period of the host.
  [[nodiscard]] Eigen::MatrixXd map() const { return cut(plant(), law, period_s, delay).closed(); }
};

/// Returns the margins; all zero for an unstable loop.
DriveMargins drive_margins(const SplitLoop& loop);

/// Returns the largest delay added to the host's torque that keeps the loop stable [ticks of the
/// drives]. Returns `most_host_ticks` periods when no limit was found, and -1 for an unstable loop.
int host_delay_margin(const SplitLoop& loop);

/// Returns the torque of one count of the drives' own encoders: (kp + kd rate) count [N m; N].
Vector drive_count_torque(const scenario::DriveLoopSpec& loop, const Vector& count);

}  // namespace tachless::linear
