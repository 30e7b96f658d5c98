#pragma once

#include <tuple>

#include "robot/quantities.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Gains of the laws that command -Kp e - Kd nu, where nudot = -A nu + B edot stands in for the
/// velocity; one of each per joint.
struct FilterGains {
  robot::Vector kp, kd, a, b;

  static constexpr std::tuple keys{
      schema::Key{"kp", &FilterGains::kp, "N m/rad", "Weight of the position error"}.in(
          schema::positive),
      schema::Key{"kd", &FilterGains::kd, "N m s/rad", "Weight of the filter output"}.in(
          schema::positive),
      schema::Key{"a", &FilterGains::a, "1/s", "Filter pole"}.in(schema::positive),
      schema::Key{"b", &FilterGains::b, "1/s", "Filter gain"}.in(schema::positive)};
};

}  // namespace tachless::controller::law
