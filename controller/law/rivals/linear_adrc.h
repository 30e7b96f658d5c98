#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "base/elementary.h"
#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

struct LinearAdrcGains {
  Vector bandwidth, observer, inertia;

  static constexpr std::tuple keys{
      gain("bandwidth", &LinearAdrcGains::bandwidth, "rad/s", "Double pole of the error, w_c"),
      gain("observer", &LinearAdrcGains::observer, "1/s", "Triple pole of the observer, w_o"),
      gain("inertia", &LinearAdrcGains::inertia, "kg m2", "Inertia of the joint, 1/b_0")};
};

/// Linear active disturbance rejection from link positions alone, for each joint, parametrised by
/// bandwidths (`source`). It acts on the error e = q - q_ref, beside the feed-forward of the other
/// laws:
///
///   tau = ID(q, v_ref, vdot_ref) + m u,   u = -w_c^2 z1 - 2 w_c z2 - z3,
///   z1dot = z2 + 3 w_o (e - z1),  z2dot = z3 + u + 3 w_o^2 (e - z1),  z3dot = w_o^3 (e - z1).
///
/// z3 estimates everything that accelerates e beside u: coupling, payload, friction. The law in
/// `source` has no model of the robot but m. Without the feed-forward z3 would have to follow
/// gravity too.
class LinearAdrc : public RigidLaw<LinearAdrcGains> {
 public:
  static constexpr std::string_view name = "linear_adrc";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"edot_hat", "rad/s"},
                                      Signal{"disturbance", "N m"}};
  static constexpr std::string_view source =
      "Z. Gao, Scaling and bandwidth-parameterization based controller tuning, Proc. American "
      "Control Conference, 2003, on the error beside a feed-forward";
  static constexpr std::string_view proved =
      "stable for one joint of known inertia, in continuous time; nothing for a robot";
  static constexpr std::string_view conditions =
      "w_o several times w_c, and low beside the sampling rate and the delay; the eigenvalues of "
      "M(q)^-1 diag(inertia) between 0.2 and 3, which coupled arms of six joints do not have";

  using Measurement = messages::PositionMeasurement;
  struct Memory {
    Vector z1;  ///< estimate of e [rad]
    Vector z2;  ///< estimate of the rate of e [rad/s]
    Vector z3;  ///< estimate of every other acceleration of e [rad/s^2]
    Vector u;   ///< acceleration that the last command asked for beside the feed-forward

    static constexpr std::tuple members{&Memory::z1, &Memory::z2, &Memory::z3, &Memory::u};
  };
  using LawOf::LawOf;

  /// Computes gains with the observer at a third of the filter's pole, so that observer and filter
  /// have the same lag.
  static Gains tuned(const Tuning& t) { return {t.each(t.w), t.each(t.filter / 3), t.inertia}; }

  /// Returns the memory before the first step, after which z is (e, 0, 0).
  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Vector zero = each(0);
    return {measured.q - reference.q_ref, zero, zero, zero};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    Memory next = observed(memory, e);
    const Vector& w = gains_.bandwidth;
    next.u = -(w.cwiseAbs2().cwiseProduct(next.z1) + 2 * w.cwiseProduct(next.z2) + next.z3);
    const auto [v_ref, a_ref] = ahead(reference);
    const Vector feedforward = robot::inverse_dynamics(robot_, measured.q, v_ref, a_ref);
    const Vector tau = feedforward + gains_.inertia.cwiseProduct(next.u);
    const Vector z2 = next.z2, z3 = gains_.inertia.cwiseProduct(next.z3);
    if (const Vector& limit = settings_.torque_limit; limit.size() > 0) {
      // The observer gets the torque that the drive gives, so a saturated drive does not wind z3
      // up.
      const Vector given = tau.cwiseMax(-limit).cwiseMin(limit);
      next.u += (given - tau).cwiseQuotient(gains_.inertia);
    }
    return {next, {tau}, {signals.size(), {e, z2, z3}}};
  }

 private:
  /// Returns the observer's state after a tick. The chain of integrators is exact for a held u; the
  /// correction places all three poles at exp(-w_o h), with the newest measurement in it.
  [[nodiscard]] Memory observed(const Memory& z, const Vector& e) const {
    const double h = settings_.period_s;
    Memory next = z;
    next.z2 = z.z2 + h * (z.z3 + z.u);
    next.z1 = z.z1 + h * z.z2 + h * h / 2 * (z.z3 + z.u);
    for (Eigen::Index i = 0; i < e.size(); ++i) {
      const double pole = base::exp(-gains_.observer[i] * h), faster = 1 - pole;
      const double wrong = e[i] - next.z1[i];
      next.z1[i] += (1 - pole * pole * pole) * wrong;
      next.z2[i] += 1.5 * faster * faster * (1 + pole) / h * wrong;
      next.z3[i] += faster * faster * faster / (h * h) * wrong;
    }
    return next;
  }
};

static_assert(OutputFeedbackLaw<LinearAdrc>);

}  // namespace tachless::controller::law
