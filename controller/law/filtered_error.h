#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

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

  Filter filter_ = this->filter(filter_pole(), filter_gain());
};

}  // namespace tachless::controller::law
