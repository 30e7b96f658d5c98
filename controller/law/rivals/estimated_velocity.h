#pragma once

#include <array>

#include "controller/law/parts.h"

namespace tachless::controller::law {

/// Base of `WenBayard` with an estimate v_hat instead of the measured velocity:
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd (v_hat - v_ref).
///
/// Laws derived from it differ by the source of v_hat; the base alone is no law. `Estimator` has
/// Gains and a Memory. Its `start` returns the memory before the first position is given to `step`.
/// Its `velocity` returns the velocity at the position given last [rad/s]. With
/// `feedforward_lead_s`, the first two terms use v_ref and vdot_ref at that time ahead.
template <class Estimator>
class EstimatedVelocity : public RigidLaw<typename Estimator::Gains> {
  using Base = RigidLaw<typename Estimator::Gains>;

 public:
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"v_hat", "rad/s"}};

  using Measurement = messages::PositionMeasurement;
  using Memory = typename Estimator::Memory;
  using Base::Base;

  static auto tuned(const Tuning& tuning) { return Estimator::tuned(tuning); }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return estimator_.start(measured.q, reference);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Memory next = estimator_.step(memory, measured.q);
    const Vector e = measured.q - reference.q_ref;
    const Vector v_hat = estimator_.velocity(next);
    const auto [v_ref, a_ref] = this->ahead(reference);
    const Vector tau = robot::inverse_dynamics(this->robot_, measured.q, v_ref, a_ref) -
                       this->gains_.kp.cwiseProduct(e) -
                       this->gains_.kd.cwiseProduct(v_hat - reference.v_ref);
    return {next, {tau}, {signals.size(), {e, v_hat}}};
  }

 private:
  Estimator estimator_{this->gains_, this->settings_};
};

}  // namespace tachless::controller::law
