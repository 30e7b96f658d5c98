#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "certificate/law_loop.h"
#include "certificate/stability_certificate.h"
#include "reference/make_trajectory.h"

namespace tachless::certificate {

std::vector<Eigen::Vector2d> certified_outline(const experiment::Scenario& scenario, int i, int j) {
  constexpr int points = 72;
  constexpr double smallest = 1e-4, largest = 1e3;  // [rad; m]
  std::string why_not;
  const auto found = stability_certificate(scenario, Effort::full, why_not);
  const auto region = !found ? std::nullopt : found->largest ? found->largest : found->fastest;
  if (!region) return {};
  double level = region->region.level;
  if (region->torque) level = std::min(level, region->torque->level);
  const robot::Model links = error_model(scenario);
  const robot::Vector q_ref = reference::make_trajectory(scenario).at(0).q_ref;
  experiment::Scenario start = scenario;
  robot::Vector& q = start.plant.initial.position_rad;
  const auto inside = [&](double radius, double angle) {
    q[i] = q_ref[i] + radius * std::cos(angle);
    q[j] = q_ref[j] + radius * std::sin(angle);
    const bool in_tube =
        region->tube.size() == 0 || ((q - q_ref).array().abs() <= region->tube.array()).all();
    const LawLoop loop = law_loop(start).value();
    return in_tube &&
           lyapunov_value(loop.systems[0], region->weights, links, q, loop.initial) <= level;
  };
  std::vector<Eigen::Vector2d> outline;
  for (int k = 0; k <= points; ++k) {
    const double angle = 2 * std::numbers::pi * k / points;
    double in = 0, out = smallest;
    while (inside(out, angle) && out < largest) in = std::exchange(out, 1.2 * out);
    if (in == 0 || out >= largest) return {};
    while (out - in > 1e-4 * out) (inside((in + out) / 2, angle) ? in : out) = (in + out) / 2;
    outline.emplace_back(q_ref[i] + in * std::cos(angle), q_ref[j] + in * std::sin(angle));
  }
  return outline;
}

}  // namespace tachless::certificate
