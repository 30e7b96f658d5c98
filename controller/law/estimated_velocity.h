#pragma once

#include <array>
#include <concepts>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"

namespace tachless::controller::law {

/// Velocity from sampled positions. `start` gives the memory before the first sample is given to
/// `step`, which is then told the `ticks` >= 1 periods since the sample before; `velocity` is what
/// the memory says of the sample last given [rad/s]. The first one is v_ref.
template <class E>
concept VelocityEstimator = std::constructible_from<E, const typename E::Gains&, const Settings&> &&
    requires(const E& estimator, const typename E::Memory& memory, const robot::Vector& q,
             const loop::ReferencePoint& reference, int ticks) {
  { estimator.start(q, reference) } -> std::same_as<typename E::Memory>;
  { estimator.step(memory, q, ticks) } -> std::same_as<typename E::Memory>;
  { estimator.velocity(memory) } -> std::convertible_to<robot::Vector>;
};

/// `WenBayard` with an estimate v_hat in the place of the measured velocity:
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd (v_hat - v_ref).
///
/// Base of the laws that differ by where v_hat comes from; no law by itself.
/// Measures: link position. Memory: the estimator's.
/// With `feedforward_lead_s`, v_ref and vdot_ref of the first two terms are taken that much ahead.
template <VelocityEstimator Estimator>
class EstimatedVelocity {
 public:
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"v_hat", "rad/s"}};
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J
  using Measurement = loop::PositionMeasurement;
  using Memory = typename Estimator::Memory;
  using Gains = typename Estimator::Gains;

  static Gains tuned(const Tuning& tuning) { return Estimator::tuned(tuning); }

  EstimatedVelocity(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)),
        gains_(std::move(gains)),
        estimator_(gains_, settings),
        lead_s_(settings.feedforward_lead_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    return estimator_.start(measurement.q, reference);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    Step<Memory> result{estimator_.step(memory, measurement.q, ticks), {}, {}};
    const robot::Vector e = measurement.q - reference.q_ref;
    const robot::Vector v_hat = estimator_.velocity(result.memory);
    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    result.command.tau = robot::inverse_dynamics(model_, measurement.q, ahead.v_ref, ahead.a_ref) -
                         gains_.kp.cwiseProduct(e) -
                         gains_.kd.cwiseProduct(v_hat - reference.v_ref);
    result.signals = {signals.size(), {e, v_hat}};
    return result;
  }

 private:
  robot::Model model_;
  Gains gains_;
  Estimator estimator_;
  double lead_s_;
};

}  // namespace tachless::controller::law
