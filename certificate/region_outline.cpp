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
  const auto inside = [&](const Eigen::Vector2d& e) {
    q[i] = q_ref[i] + e[0];
    q[j] = q_ref[j] + e[1];
    const bool in_tube =
        region->tube.size() == 0 || ((q - q_ref).array().abs() <= region->tube.array()).all();
    const LawLoop loop = law_loop(start).value();
    return in_tube &&
           lyapunov_value(loop.systems[0], region->weights, links, q, loop.initial) <= level;
  };
  const auto end = [&](const Eigen::Vector2d& direction) {  // 0 or infinite: there is none
    double in = 0, out = smallest;
    while (inside(out * direction) && out < largest) in = std::exchange(out, 1.2 * out);
    if (in == 0 || out >= largest) return in == 0 ? 0.0 : infinity;
    while (out - in > 1e-4 * out) {
      const double middle = (in + out) / 2;
      (inside(middle * direction) ? in : out) = middle;
    }
    return in;
  };
  const Eigen::Vector2d axes(end(Eigen::Vector2d::UnitX()), end(Eigen::Vector2d::UnitY()));
  if (!(axes.minCoeff() > 0 && axes.maxCoeff() < infinity)) return {};
  std::vector<Eigen::Vector2d> outline;
  for (int k = 0; k <= points; ++k) {
    const double angle = 2 * std::numbers::pi * k / points;
    const Eigen::Vector2d direction(axes[0] * std::cos(angle), axes[1] * std::sin(angle));
    const double length = end(direction / direction.norm()) / direction.norm();
    if (!(length > 0 && length < infinity)) return {};
    outline.emplace_back(Eigen::Vector2d(q_ref[i], q_ref[j]) + length * direction);
  }
  return outline;
}

}  // namespace tachless::certificate
