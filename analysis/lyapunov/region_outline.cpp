#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "lyapunov/law_loop.h"
#include "lyapunov/stability_certificate.h"
#include "reference/make_trajectory.h"

namespace tachless::lyapunov {

std::vector<Eigen::Vector2d> certified_outline(const scenario::Scenario& scenario, int i, int j) {
  constexpr int points = 72;
  constexpr double smallest = 1e-4, largest = 1e3;  // [rad; m]
  std::string why_not;
  const auto found = stability_certificate(scenario, linear::Effort::full, why_not);
  const auto region = !found ? std::nullopt : found->largest ? found->largest : found->fastest;
  if (!region) return {};
  const double level = region->torque ? region->torque->level : region->region.level;
  const robot::Model links = error_model(scenario);
  const Vector q_ref = reference::make_trajectory(scenario).at(0).q_ref;
  scenario::Scenario start = scenario;
  Vector& q = start.plant.initial.position_rad;
  const auto inside = [&](const Eigen::Vector2d& e) {
    q[i] = q_ref[i] + e[0];
    q[j] = q_ref[j] + e[1];
    const LawLoop loop = law_loop(start).value();
    return lyapunov_value(loop.systems[0], region->weights, links, q, loop.initial) <= level;
  };
  // The length along a ray, looked for from `first` on; infinite: no end.
  const auto end = [&](const Eigen::Vector2d& ray, double first) {
    double in = 0, out = first;
    while (inside(out * ray)) {
      in = std::exchange(out, 1.2 * out);
      if (out * ray.norm() > largest) return infinity;
    }
    while (out - in > 1e-4 * out && out > smallest * first) {
      const double middle = (in + out) / 2;
      (inside(middle * ray) ? in : out) = middle;
    }
    return in;
  };
  // Other joints may begin outside of the region's tube; these leave its level set before that.
  if (!inside(Eigen::Vector2d::Zero()) ||
      (region->tube.size() > 0 && ((q - q_ref).array().abs() > region->tube.array()).any())) {
    return {};
  }
  const Eigen::Vector2d axes(end(Eigen::Vector2d::UnitX(), smallest),
                             end(Eigen::Vector2d::UnitY(), smallest));
  if (!axes.allFinite()) return {};
  std::vector<Eigen::Vector2d> outline;
  for (int k = 0; k <= points; ++k) {
    const double angle = 2 * std::numbers::pi * k / points;
    const Eigen::Vector2d ray(axes[0] * std::cos(angle), axes[1] * std::sin(angle));
    outline.emplace_back(Eigen::Vector2d(q_ref[i], q_ref[j]) + end(ray, 0.5) * ray);
  }
  return outline;
}

}  // namespace tachless::lyapunov
