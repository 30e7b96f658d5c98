#pragma once

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/cholesky.h"
#include "robot/inverse_dynamics.h"
#include "robot/mass_matrix.h"
#include "robot/model.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot from link positions alone, with an observer that is a model of the
/// robot: S. Nicosia and P. Tomei, "Robot control by using only joint position measurements", IEEE
/// Trans. Automatic Control 35(9), 1990, in the form implemented here,
///
///   x1dot = x2 + k_D (q - x1) =: v_hat,
///   x2dot = M(q)^-1 [tau - C(q, v_hat) v_hat - g(q) + KO (q - x1)],
///   tau = M(q) vdot_ref + C(q, v_hat) v_ref + g(q) - Kp e - Kv (v_hat - v_ref).
///
/// Measures: link position. Memory: the observer, the position of the sample before and the torques
/// commanded up to then, of which the one that acts is the observer's tau. With
/// `feedforward_lead_s`, v_ref and vdot_ref in the first two terms are taken that much ahead; what
/// is measured or estimated is not.
class NicosiaTomei {
 public:
  static constexpr std::string_view name = "nicosia_tomei";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"v_hat", "rad/s"}};
  static constexpr std::string_view source =
      "S. Nicosia and P. Tomei, Robot control by using only joint position measurements, IEEE "
      "Trans. Automatic Control 35(9), 1990, in the form implemented here";
  static constexpr std::string_view proved = "locally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "observer_kd lambda_min(M) > k_c (sup |v| and what the initial errors add), with |C(q, x) y| "
      "<= k_c |x| |y|; small initial errors, the observer's included; the torque acts as commanded";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J
  using Measurement = loop::PositionMeasurement;

  struct Memory {
    robot::Vector delta;       ///< q - x1 [rad]
    robot::Vector x2;          ///< [rad/s]
    robot::Vector q_previous;  ///< [rad]
    /// Commanded then and in the ticks before, as far back as the delay goes [N m]; empty before
    /// the first step, and beyond.
    std::array<robot::Vector, Settings::most_delay + 1> tau;

    static constexpr std::tuple members{&Memory::delta, &Memory::x2, &Memory::q_previous,
                                        &Memory::tau};
  };

  struct Gains {
    robot::Vector kp, kv;
    double observer_kd = 0;
    robot::Vector observer_ko;

    static constexpr std::tuple keys{
        schema::Key{"kp", &Gains::kp, "N m/rad", "Weight of the position error"}.in(
            schema::positive),
        schema::Key{"kv", &Gains::kv, "N m s/rad", "Weight of the estimated velocity error"}.in(
            schema::positive),
        schema::Key{"observer_kd", &Gains::observer_kd, "1/s",
                    "Gain of the observer from its error to the velocity estimate"}
            .in(schema::positive),
        schema::Key{"observer_ko", &Gains::observer_ko, "N m/rad",
                    "Gain of the observer from its error to its torque"}
            .in(schema::positive)};
  };

  /// The observer has two poles at the filter's.
  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), 2 * t.filter, t.filter * t.filter * t.inertia};
  }

  NicosiaTomei(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)),
        gains_(std::move(gains)),
        lead_s_(settings.feedforward_lead_s),
        period_s_(settings.period_s),
        delay_(static_cast<std::size_t>(settings.command_delay)) {
    if (settings.command_delay < 0 || settings.command_delay > Settings::most_delay) {
      throw std::logic_error("nicosia_tomei: no such delay");
    }
  }

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    return {robot::Vector::Zero(measurement.q.size()), reference.v_ref, measurement.q, {}};
  }

  /// @throw std::logic_error when M(q) is not positive definite (see robot::forward_dynamics).
  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    Step<Memory> result{memory, {}, {}};
    if (memory.tau[0].size() > 0) observe(result.memory, measurement.q, ticks);
    const robot::Vector v_hat = result.memory.x2 + gains_.observer_kd * result.memory.delta;

    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    result.command.tau =
        robot::inverse_dynamics_bilinear(model_, measurement.q, v_hat, ahead.v_ref, ahead.a_ref) -
        gains_.kp.cwiseProduct(e) - gains_.kv.cwiseProduct(v_hat - reference.v_ref);
    result.memory.q_previous = measurement.q;
    // Ticks whose command was lost held the one before; those before the first command, that one.
    for (std::size_t j = 0; j <= delay_; ++j) {
      const auto lost = static_cast<std::size_t>(ticks) - 1;
      const bool first = j == 0 || memory.tau[0].size() == 0;
      result.memory.tau[j] = first ? result.command.tau : memory.tau[j > lost ? j - 1 - lost : 0];
    }
    result.signals = {signals.size(), {e, v_hat}};
    return result;
  }

 private:
  /// delta and x2 after `ticks` periods in which q goes straight from `q_previous` to `q` under the
  /// torques that acted, period by period by the
  /// implicit midpoint rule,
  ///   d = delta + h/2 (qdot - x - k_D d),   x = x2 + h/2 M^-1 [tau - C v_hat - g + KO d],
  /// (d, x) the middle of (delta, x2), M, C and g at the middle of q; v_hat in the slow term C
  /// v_hat is the period's first. Without x that is linear in d, with a positive definite matrix.
  void observe(Memory& memory, const robot::Vector& q, int ticks) const {
    const double h = period_s_, kd = gains_.observer_kd;
    const robot::Vector advance = (q - memory.q_previous) / ticks;  // of one period
    const robot::Vector qdot = advance / h;
    const robot::Vector zero = robot::Vector::Zero(q.size());
    for (int i = 0; i < ticks; ++i) {
      const auto passed = static_cast<std::size_t>(i);
      const robot::Vector& tau = memory.tau[passed < delay_ ? delay_ - passed : 0];
      const robot::Vector q_middle = memory.q_previous + (i + 0.5) * advance;
      const robot::Vector v_hat = memory.x2 + kd * memory.delta;
      const robot::Matrix M = robot::mass_matrix(model_, q_middle);
      robot::Matrix matrix = (1 + h * kd / 2) * M;
      matrix.diagonal() += h * h / 4 * gains_.observer_ko;
      if (robot::factorise(matrix) >= 0) {
        throw std::logic_error("nicosia_tomei: the inertia matrix is not positive definite");
      }
      robot::Vector middle =
          M * (memory.delta + h / 2 * (qdot - memory.x2)) +
          h * h / 4 * (robot::inverse_dynamics(model_, q_middle, v_hat, zero) - tau);
      robot::solve_in_place(matrix, middle);
      const robot::Vector x2_middle = qdot - kd * middle - 2 / h * (middle - memory.delta);
      memory.x2 = 2 * x2_middle - memory.x2;
      memory.delta = 2 * middle - memory.delta;
    }
  }

  robot::Model model_;
  Gains gains_;
  double lead_s_;
  double period_s_;
  std::size_t delay_;
};

static_assert(OutputFeedbackLaw<NicosiaTomei>);

}  // namespace tachless::controller::law
