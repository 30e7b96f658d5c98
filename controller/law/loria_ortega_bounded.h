#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/filtered_error.h"

namespace tachless::controller::law {

struct BoundedGains {
  Vector kp, kd, a, b;
  Vector feedforward_max;
  double linear = 0.8;

  static constexpr std::tuple keys{
      gain("kp", &BoundedGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &BoundedGains::kd, "N m s/rad", "Weight of the filter output"),
      gain("a", &BoundedGains::a, "1/s", "Filter pole"),
      gain("b", &BoundedGains::b, "1/s", "Filter gain"),
      gain("feedforward_max", &BoundedGains::feedforward_max, "N m",
           "Largest torque of the feed-forward, below the drive's limit")
          .by_default("7/10 of the drive's limit"),
      base::Key{"linear", &BoundedGains::linear, "1",
                "Share of the feedback's torque up to which the feedback is linear"}
          .in({0, 1, true, true})
          .by_default()};
};

/// `LoriaOrtegaRigid` whose torque stays within the drives' limits for every input:
///
///   tau = clip(ID(q, v_ref, vdot_ref), +-F) + S(-Kp e - Kd nu),   F + L = the drive's limit,
///   S(u) = u for |u| <= k L, and sign(u) [k L + (1 - k) L tanh((|u| - k L) / ((1 - k) L))] beyond.
///
/// The friction that is fed forward is part of ID. S is continuously differentiable, strictly
/// increasing and bounded by L. F is `feedforward_max` and k is `linear`. The law is
/// `LoriaOrtegaRigid` while the clip does not act and |Kp e + Kd nu| <= k L.
class LoriaOrtegaBounded : public FilteredError<LoriaOrtegaBounded, BoundedGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_bounded";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"},
                                      Signal{"feedback", "N m"}};
  static constexpr std::string_view source =
      "derived here from A. Loria and R. Ortega, On tracking control of rigid and flexible joint "
      "robots, Appl. Math. and Comp. Sci. 5(2), 1995, eq. 4-5";
  static constexpr std::string_view proved =
      "torque within the limits; globally convergent where the reference comes to rest or friction "
      "is large enough, else exponentially stable in a certified region, in continuous time";
  static constexpr std::string_view conditions =
      "|ID(q, v_ref, vdot_ref)| is below feedforward_max at every posture along the reference; for "
      "the region the matrix condition, within the level where the feedback is linear";
  static constexpr bool feeds_friction = true, needs_torque_limit = true;

  /// @throw std::invalid_argument if a drive has no limit or feedforward_max is not below it.
  LoriaOrtegaBounded(robot::Model robot, BoundedGains gains, const Settings& settings)
      : FilteredError(std::move(robot), std::move(gains), settings) {
    const Vector& limit = settings_.torque_limit;
    if (limit.size() == 0 || !limit.allFinite()) {
      throw std::invalid_argument("a joint has no torque limit");
    }
    feedforward_max_ =
        gains_.feedforward_max.size() > 0 ? gains_.feedforward_max : Vector(0.7 * limit);
    feedback_max_ = limit - feedforward_max_;
    if (!(feedback_max_.array() > 0).all()) {
      throw std::invalid_argument(
          "feedforward_max reaches plant.drive.torque_limit_Nm; it has to leave a torque for the "
          "feedback");
    }
  }

  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), t.each(t.filter), t.each(t.filter), {}, 0.8};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    const Memory next = filter_.step(memory, e);
    Vector torque = feedforward(measured.q, reference);
    if (settings_.friction.given()) torque += settings_.friction.torque(ahead(reference).v_ref);
    const Vector back = bounded(feedback(Vector::Zero(e.size()), e, next.nu, reference));
    const Vector tau = torque.cwiseMax(-feedforward_max_).cwiseMin(feedforward_max_) + back;
    return {next, {tau}, {signals.size(), {e, next.nu, back}}};
  }

  /// Returns S(u) [N m].
  [[nodiscard]] Vector bounded(const Vector& u) const {
    Vector result = u;
    for (Eigen::Index i = 0; i < u.size(); ++i) {
      const double linear = gains_.linear * feedback_max_[i], rest = feedback_max_[i] - linear;
      const double beyond = std::abs(u[i]) - linear;
      if (beyond > 0) result[i] = std::copysign(linear + rest * base::tanh(beyond / rest), u[i]);
    }
    return result;
  }

  /// Returns the largest torque of the feed-forward, F [N m].
  [[nodiscard]] const Vector& feedforward_max() const { return feedforward_max_; }
  /// Returns the torque up to which the feedback is linear, k L [N m].
  [[nodiscard]] Vector linear_feedback() const { return gains_.linear * feedback_max_; }

 private:
  Vector feedforward_max_, feedback_max_;  ///< [N m]
};

static_assert(OutputFeedbackLaw<LoriaOrtegaBounded>);

}  // namespace tachless::controller::law
