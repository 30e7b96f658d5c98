#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "experiment/scenario.h"

namespace tachless::experiment {

std::string urdf_scenario(const robot::Model& model, const std::string& name,
                          const std::string& urdf, double period_s) {
  std::vector<double> from, to;
  double duration = 2;
  for (int i = 0; i < model.num_joints; ++i) {
    const bool slides =
        model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::prismatic;
    const double low = model.lower[i], high = model.upper[i];
    const bool bounded = std::isfinite(low) && std::isfinite(high);
    const double room = bounded ? 0.25 * (high - low) : 1;
    const double start = bounded ? std::clamp(0.0, low + room, high - room) : 0;
    const double step = std::min(slides ? 0.1 : 0.3, room);
    from.push_back(start);
    // Both ends are a quarter of the range away from its limits: the robot overshoots a little.
    to.push_back(!bounded || start + step <= high - room ? start + step : start - step);
    // The polynomial of degree 9 peaks at 2.46 times its mean speed.
    if (std::isfinite(model.velocity_limit[i])) {
      duration = std::max(duration, 3 * step / model.velocity_limit[i]);
    }
  }
  duration = std::ceil(10 * duration) / 10;
  const auto ticks = static_cast<long long>(std::ceil((duration + 3) / period_s));
  return fmt::format(
      "name: {}\n"
      "robot:\n  name: arm\n  urdf: {}\n  joints: rigid\n"
      "plant:\n  initial: {{position_rad: [{:.6g}]}}\n  encoder: {{resolution_bits: 20}}\n"
      "reference:\n  point_to_point:\n    from_rad: [{:.6g}]\n    to_rad: [{:.6g}]\n"
      "    start_s: 0.2\n    duration_s: {:g}\n"
      "controller:\n  law: loria_ortega_rigid\n  gains: {{kp: 1, kd: 1, a: 1, b: 1}}\n"
      "  filter: tustin\n  feedforward_lead: half_tick_plus_delay\n"
      "loop: {{mode: lockstep, period_s: {:g}, duration_s: {:.12g}, command_delay: 1}}\n",
      name, urdf, fmt::join(from, ", "), fmt::join(from, ", "), fmt::join(to, ", "), duration,
      period_s, static_cast<double>(ticks) * period_s);
}

}  // namespace tachless::experiment
