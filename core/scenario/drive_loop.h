#pragma once

#include <optional>
#include <string_view>
#include <tuple>

#include "base/quantities.h"
#include "base/schema.h"
#include "scenario/scenario.h"

namespace tachless::scenario {

/// The loop inside the drives. At its own rate each drive adds kp (q_des - q) + kd (v_des - v) to
/// the host's torque. The position q is the drive's own, and the velocity v is derived from q. The
/// host sends q_des, v_des and the torque. A scenario has this loop if it gives `plant.drive.loop`.
struct DriveLoopSpec {
  double period_s = 0;
  Vector kp, kd;
  std::optional<double> velocity_filter_hz;  ///< nothing: the difference of two positions
  int delay_ticks = 1;  ///< delay from a position to the torque [ticks of the drive]
  int late_ticks = 0;
  std::optional<Vector> resolution_bits;  ///< nothing: ideal

  static constexpr int max_ticks = 1000;

  static constexpr std::tuple keys{
      base::Key{"period_s", &DriveLoopSpec::period_s, "s",
                "One tick of the drives; `loop.period_s` is a whole number of them"}
          .in({1e-6, 1}),
      base::Key{"kp", &DriveLoopSpec::kp, "N m/rad (N/m)",
                "Gain of the drive's own position error, at the joint"}
          .in(base::not_negative),
      base::Key{"kd", &DriveLoopSpec::kd, "N m s/rad", "Gain of the drive's own velocity error"}.in(
          base::not_negative),
      base::Key{"velocity_filter_hz", &DriveLoopSpec::velocity_filter_hz, "Hz",
                "Cutoff of the first-order filter of the drive's velocity"}
          .in(base::positive)
          .by_default("none: the difference of two positions"),
      base::Key{"delay_ticks", &DriveLoopSpec::delay_ticks, "the drive's ticks",
                "From a position of the drive to the tick over which its torque acts"}
          .in({0, max_ticks})
          .by_default(),
      base::Key{"late_ticks", &DriveLoopSpec::late_ticks, "the drive's ticks",
                "Age beyond `loop.command_delay` at which the drive uses a command; less than a "
                "tick of the loop"}
          .in({0, max_ticks})
          .by_default(),
      base::Key{"resolution_bits", &DriveLoopSpec::resolution_bits, "bit",
                "2^bits counts per revolution of the drive's own encoder, at the joint"}
          .in(base::whole(1, 52))
          .by_default("none: ideal")};
};

/// Returns the loop inside the drives, the map `plant.drive.loop`; nothing without one. The
/// scenario holds it as text.
/// @throw Failure(bad_usage), one line: where, key, value, what is allowed.
std::optional<DriveLoopSpec> drive_loop(const Scenario& scenario);

/// Returns the width of one count of each drive's own encoder [rad; m if prismatic]; 0: ideal.
/// @throw Failure(bad_usage) as `encoder_count`
Vector drive_count(const Scenario& scenario, const DriveLoopSpec& loop, const robot::Model& model);

/// Refuses a scenario with `plant.drive.loop`.
/// @param why one clause: "identify needs the whole torque"
/// @throw Failure(bad_usage)
void require_no_drive_loop(const Scenario& scenario, std::string_view why);

}  // namespace tachless::scenario
