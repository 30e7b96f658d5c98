#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot with measured velocity and known parameters: J.-J. E. Slotine and
/// W. Li, "Adaptive manipulator control: a case study", IEEE Trans. Automatic Control 33(11), 1988,
/// without its adaptation:
///
///   v_r = v_ref - Lambda e,   s = v - v_r,   tau = M(q) v_rdot + C(q, v) v_r + g(q) - Ks s.
///
/// Measures: the full state. Memory: none. Conditions: any positive gains, globally. With
/// `feedforward_lead_s`, v_ref and vdot_ref in the first two terms are taken that much ahead; e, s
/// and edot are not.
class SlotineLi {
 public:
  static constexpr std::string_view name = "slotine_li";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"edot", "rad/s"}};
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J
  using Measurement = loop::StateMeasurement;
  struct Memory {};

  struct Gains {
    robot::Vector lambda;  ///< [1/s]
    robot::Vector ks;      ///< [N m s/rad]

    static constexpr std::array<GainName<Gains>, 2> names{
        {{"lambda", &Gains::lambda}, {"ks", &Gains::ks}}};
  };

  SlotineLi(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)), gains_(std::move(gains)), lead_s_(settings.feedforward_lead_s) {}

  [[nodiscard]] Memory start(const Measurement& /*measurement*/,
                             const loop::ReferencePoint& /*reference*/) const {
    return {};
  }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    const robot::Vector edot = measurement.v - reference.v_ref;
    const robot::Vector s = edot + gains_.lambda.cwiseProduct(e);
    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    const robot::Vector v_r = ahead.v_ref - gains_.lambda.cwiseProduct(e);
    const robot::Vector a_r = ahead.a_ref - gains_.lambda.cwiseProduct(edot);
    Step<Memory> result;
    result.command.tau =
        robot::inverse_dynamics_bilinear(model_, measurement.q, measurement.v, v_r, a_r) -
        gains_.ks.cwiseProduct(s);
    result.signals = {signals.size(), {e, edot}};
    return result;
  }

 private:
  robot::Model model_;
  Gains gains_;
  double lead_s_;
};

static_assert(Law<SlotineLi>);
static_assert(!OutputFeedbackLaw<SlotineLi>);

}  // namespace tachless::controller::law
