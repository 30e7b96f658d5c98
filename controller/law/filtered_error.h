#pragma once

#include <array>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// Returns the key of a gain that `w` and `damping` may take the place of.
template <class Gains>
constexpr base::Key<Gains, Vector> gain_beside_w(std::string_view name, Vector Gains::*member,
                                                 std::string_view unit, std::string_view meaning) {
  return base::Key{name, member, unit, meaning}.in(base::not_negative).by_default("0; needs w");
}
/// Returns the keys of the gains that follow the reference.
template <class Gains>
constexpr base::Key<Gains, double> bandwidth_key(double Gains::*member) {
  return base::Key{"w", member, "rad/s", "Bandwidth: adds w^2 M(q_ref) to kp"}
      .in(base::not_negative)
      .by_default();
}
template <class Gains>
constexpr base::Key<Gains, double> damping_key(double Gains::*member) {
  return base::Key{"damping", member, "1", "Damping: adds 2 damping w M(q_ref) to kd"}
      .in(base::not_negative)
      .by_default();
}

/// Base of the laws for rigid joints that feed back -Kp e - Kd nu, with nudot = -A nu + B edot.
/// Their stability is proved by eq. 15 of Loria and Ortega (1995). The base alone is no law. `Self`
/// is the law; its declarations replace the base's declarations. Kd B^-1 and Kd B^-1 A are
/// symmetric.
template <class Self, class G = FilterGains>
class FilteredError : public RigidLaw<G> {
 public:
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"}};

  using Measurement = messages::PositionMeasurement;
  using Memory = Filter::Memory;
  using RigidLaw<G>::RigidLaw;

  static G tuned(const Tuning& t) { return {t.kp(), t.kd(), t.each(t.filter), t.each(t.filter)}; }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return filter_.start(measured.q - reference.q_ref);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    const Memory next = filter_.step(memory, e);
    const Vector tau =
        law().feedback(law().feedforward(measured.q, reference), e, next.nu, reference);
    return {next, {tau}, {signals.size(), {e, next.nu}}};
  }

  /// Returns M(q) vdot_ref + C(q, v_ref) v_ref + g(q) [N m].
  [[nodiscard]] Vector feedforward(const Vector& q, const ReferencePoint& reference) const {
    const auto [v_ref, a_ref] = this->ahead(reference);
    return robot::inverse_dynamics(this->robot_, q, v_ref, a_ref);
  }
  /// Returns tau - Kp e - Kd nu [N m].
  [[nodiscard]] Vector feedback(const Vector& tau, const Vector& e, const Vector& nu,
                                const ReferencePoint& /*reference*/) const {
    return tau - this->gains_.kp.cwiseProduct(e) - this->gains_.kd.cwiseProduct(nu);
  }
  /// Returns Kp_dot e + Kd_dot nu [N m/s]; it is zero unless the gains follow the reference.
  [[nodiscard]] Vector feedback_rate(const Vector& e, const Vector& /*nu*/,
                                     const ReferencePoint& /*reference*/) const {
    return Vector::Zero(e.size());
  }

  /// Returns tau - Kp e - Kd nu with gains that follow the reference [N m]: Kp = w^2 M(q_ref) + w
  /// D, Kd = 2 damping w M(q_ref), D the viscous friction that is fed forward.
  [[nodiscard]] Vector inertial_feedback(const Vector& tau, const Vector& e, const Vector& nu,
                                         const ReferencePoint& reference) const {
    const Matrix M = robot::mass_matrix(this->robot_, reference.q_ref);
    const Vector inertial = tau - M.lazyProduct(inertial_sum(e, nu));
    const Vector& viscous = this->settings_.friction.viscous;
    return viscous.size() == 0 ? inertial : inertial - this->gains_.w * viscous.cwiseProduct(e);
  }
  /// Returns Kp_dot e + Kd_dot nu of these gains [N m/s].
  [[nodiscard]] Vector inertial_feedback_rate(const Vector& e, const Vector& nu,
                                              const ReferencePoint& reference) const {
    const Matrix C = robot::coriolis_matrix(this->robot_, reference.q_ref, reference.v_ref);
    const Vector x = inertial_sum(e, nu);
    return C.lazyProduct(x) + C.transpose().lazyProduct(x);  // Mdot = C + C'
  }
  /// Returns the diagonal of A [1/s].
  [[nodiscard]] Vector filter_pole() const { return this->each(this->gains_.a); }
  /// Returns the diagonal of B [1/s].
  [[nodiscard]] Vector filter_gain() const { return this->each(this->gains_.b); }

  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė";
  /// Returns eq. 15 with the weights [J].
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    const Vector e = state.q - reference.q_ref, edot = state.v - reference.v_ref;
    const Vector& nu = state.controller.value[1];
    const Vector none = Vector::Zero(e.size());
    return equation_15(e, edot, nu, robot::mass_matrix(this->robot_, state.q) * edot,
                       -law().feedback(none, e, none, reference),
                       -law().feedback(none, none, nu.cwiseQuotient(filter_gain()), reference),
                       weights);
  }

 protected:
  [[nodiscard]] const Self& law() const { return static_cast<const Self&>(*this); }
  [[nodiscard]] Vector inertial_sum(const Vector& e, const Vector& nu) const {
    const double w = this->gains_.w;
    return w * w * e + 2 * this->gains_.damping * w * nu;
  }

  Filter filter_ = this->filter(filter_pole(), filter_gain());
};

/// Base of the laws of `FilteredError` whose gains have a part that follows the reference: Kp =
/// diag(kp) + w^2 M(q_ref) + w D, Kd = diag(kd) + 2 damping w M(q_ref).
template <class Self, class G>
class FollowingGains : public FilteredError<Self, G> {
 public:
  /// @throw std::invalid_argument unless the gains give kp and kd, or w and damping.
  FollowingGains(robot::Model robot, G gains, const Settings& settings)
      : FilteredError<Self, G>(std::move(robot), std::move(gains), settings) {
    G& g = this->gains_;
    const auto given = [](const Vector& x) { return x.size() > 0 && (x.array() > 0).all(); };
    if (!(given(g.kp) && given(g.kd)) && !(g.w > 0 && g.damping > 0)) {
      throw std::invalid_argument(
          "a joint has no feedback; give kp and kd, or w and damping, greater than 0");
    }
    for (Vector* each : {&g.kp, &g.kd}) {
      if (each->size() == 0) *each = this->each(0);
    }
  }

  [[nodiscard]] Vector feedback(const Vector& tau, const Vector& e, const Vector& nu,
                                const ReferencePoint& reference) const {
    const Vector constant = FilteredError<Self, G>::feedback(tau, e, nu, reference);
    return follows() ? this->inertial_feedback(constant, e, nu, reference) : constant;
  }
  [[nodiscard]] Vector feedback_rate(const Vector& e, const Vector& nu,
                                     const ReferencePoint& reference) const {
    return follows() ? this->inertial_feedback_rate(e, nu, reference) : Vector::Zero(e.size());
  }
  /// Returns whether the gains follow the reference.
  [[nodiscard]] bool follows() const { return this->gains_.w > 0; }
};

}  // namespace tachless::controller::law
