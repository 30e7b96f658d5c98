#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>

#include "base/elementary.h"
#include "base/quantities.h"
#include "base/schema.h"
#include "robot/joint_friction.h"

namespace tachless::controller::law {

/// Discretisation of the continuous filter for sampled positions. Each kind has the form nu_k = phi
/// nu_{k-1} + beta (e_k - e_{k-1}).
enum class Discretisation {
  first_order_hold,  ///< ramp-invariant: exact for e piecewise linear
  tustin,
  backward_euler,
  zero_order_hold,  ///< inflates the gain by a h / (1 - phi): for comparison only
};
/// Returns the names in scenarios.
constexpr std::array<std::string_view, 4> names(Discretisation /*type*/) {
  return {"first_order_hold", "tustin", "backward_euler", "zero_order_hold"};
}

/// Initial state w of the filter `wdot = A (e - w)`, `nu = B (e - w)`.
enum class FilterStart {
  at_error,  ///< w(0) = e(0), hence nu(0) = 0
  zero,      ///< w(0) = 0, hence nu(0) = B e(0): the plain transfer function, with a torque step at
             ///< the start
};
/// Returns the names in scenarios.
constexpr std::array<std::string_view, 2> names(FilterStart /*type*/) {
  return {"at_error", "zero"};
}

}  // namespace tachless::controller::law

/// The scenario's `controller` map, with each value declared once beside its key. The header holds
/// values only: no law and no parser.
namespace tachless::controller {

/// Name of a law that a program outside tachless computes.
inline constexpr std::string_view external_law_name = "external";

/// Time by which the feed-forward is evaluated ahead.
enum class FeedforwardLead { none, half_tick_plus_delay };
constexpr std::array<std::string_view, 2> names(FeedforwardLead /*type*/) {
  return {"none", "half_tick_plus_delay"};
}

/// Friction that a law feeds forward from the reference: D v_ref + (Fc + c |g(q_ref)|)
/// tanh(v_ref / smoothing) + Fr tanh(v_ref / rise_velocity). The vectors are empty if none is
/// given.
struct FrictionSpec {
  Vector viscous;                  ///< D [N m s/rad]
  Vector coulomb;                  ///< Fc [N m; N]
  Vector smoothing;                ///< [rad/s; m/s]
  Vector rise{}, rise_velocity{};  ///< Fr [N m; N] and its speed [rad/s; m/s]; empty: none
  Vector load{};                   ///< c; empty: none

  [[nodiscard]] bool given() const {
    return viscous.size() > 0 &&
           !(viscous.isZero(0) && coulomb.isZero(0) && rise.isZero(0) && load.isZero(0));
  }
  /// Returns whether the friction grows with gravity's torque.
  [[nodiscard]] bool needs_gravity() const { return !load.isZero(0); }
  /// @param gravity torque g(q_ref) [N m; N]; not read unless `needs_gravity`
  [[nodiscard]] Vector torque(const Vector& v_ref, const Vector& gravity) const {
    const Vector dry = needs_gravity() ? coulomb + load.cwiseProduct(gravity.cwiseAbs()) : coulomb;
    Vector torque = viscous.cwiseProduct(v_ref) +
                    dry.cwiseProduct(v_ref.cwiseQuotient(smoothing).unaryExpr(&base::tanh));
    for (Eigen::Index i = 0; i < rise.size(); ++i) {
      if (rise[i] != 0) torque[i] += robot::friction_rise(v_ref[i], rise[i], rise_velocity[i]);
    }
    return torque;
  }
  /// Returns a bound of the part that is not viscous [N m; N].
  /// @param gravity bound of gravity's torque [N m; N]; not read unless `needs_gravity`
  [[nodiscard]] Vector largest_dry(const Vector& gravity) const {
    Vector largest = coulomb;
    if (rise.size() > 0) largest += rise.cwiseMax(0);
    if (needs_gravity()) largest += load.cwiseProduct(gravity.cwiseAbs());
    return largest;
  }

  static constexpr std::tuple keys{
      base::Key{"viscous", &FrictionSpec::viscous, "N m s/rad (N s/m)",
                "D of D v_ref; the joints of the robot are rigid"}
          .in(base::not_negative)
          .by_default(0),
      base::Key{"coulomb", &FrictionSpec::coulomb, "N m (N)", "Fc of Fc tanh(v_ref / smoothing)"}
          .in(base::not_negative)
          .by_default(0),
      base::Key{"smoothing", &FrictionSpec::smoothing, "rad/s (m/s)",
                "Reference velocity over which Coulomb's part turns round"}
          .in(base::positive)
          .by_default(0.01),
      base::Key{"rise", &FrictionSpec::rise, "N m (N)",
                "Fr of Fr tanh(v_ref / rise_velocity); negative: friction falls with speed"}
          .by_default(0),
      base::Key{"rise_velocity", &FrictionSpec::rise_velocity, "rad/s (m/s)",
                "Reference velocity over which the rise turns round"}
          .in(base::positive)
          .by_default(0.1),
      base::Key{
          "load", &FrictionSpec::load, "",
          "c of c g tanh(v_ref / smoothing), with the size g of gravity's torque at q_ref by the "
          "law's robot"}
          .in({0, 1})
          .by_default(0)};
};

/// The scenario's `controller` map.
struct Spec {
  std::string law;
  std::string measurement;  ///< suffix of the channel that feeds the law; empty: the law's own
  std::string announced;    ///< name that a recorded run's external law announced; else empty
  std::string urdf_path;    ///< path as in the scenario; empty: the law's robot is the plant's
  /// Gains by name, each of length num_joints, or its square for a matrix, row by row.
  std::map<std::string, Vector> gains;
  bool gains_may_change = false;
  FrictionSpec friction;
  law::Discretisation filter = law::Discretisation::first_order_hold;
  law::FilterStart filter_start = law::FilterStart::at_error;
  FeedforwardLead feedforward_lead = FeedforwardLead::none;

  /// Returns the law's name for messages: "loria_ortega_rigid", "my_pd (external)".
  [[nodiscard]] std::string law_text() const;
  [[nodiscard]] std::optional<base::Refusal> refusal() const;

  static constexpr base::Key urdf_key =
      base::Key{"urdf", &Spec::urdf_path, "",
                "URDF file of the robot that the law takes the plant for: the same joints in the "
                "same order, read with the same keys of `robot`"}
          .by_default("`robot.urdf`");

  static constexpr std::tuple keys{
      base::Key{"law", &Spec::law, "",
                "Name of the control law: lower-case letters, digits, `_`; `external`: a program "
                "of yours computes it (`run --controller`)"},
      base::Key{
          "measurement", &Spec::measurement, "",
          "Measurement of the law, the only one it gets; an external one needs it: `POSITION`, "
          "`MOTOR_POSITION`, `BOTH_POSITIONS`, `LINK_STATE`, `STATE`"}
          .by_default("the law's own"),
      urdf_key,
      base::Key{"gains", &Spec::gains, "",
                "The law's gains by name; which ones, with units and ranges, the law says"},
      base::Key{"gains_may_change", &Spec::gains_may_change, "",
                "`tachless gains` may change them in a run"}
          .by_default(),
      base::Key{"friction", &Spec::friction},
      base::Key{"filter", &Spec::filter, "", "How the filter b p/(p + a) is discretised"}
          .by_default(),
      base::Key{"filter_start", &Spec::filter_start, "",
                "`at_error`: w(0) = e(0), so nu(0) = 0; `zero`: w(0) = 0, kicks with Kd B e(0)"}
          .by_default(),
      base::Key{"feedforward_lead", &Spec::feedforward_lead, "",
                "Evaluates the feed-forward ahead by the mean age of a held torque"}
          .by_default()};
};

}  // namespace tachless::controller
