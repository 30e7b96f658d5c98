#pragma once

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/parts.h"
#include "robot/cholesky.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

struct NicosiaTomeiGains {
  Vector kp, kv;
  double observer_kd = 0;
  Vector observer_ko;

  static constexpr std::tuple keys{
      gain("kp", &NicosiaTomeiGains::kp, "N m/rad", "Weight of the position error"),
      gain("kv", &NicosiaTomeiGains::kv, "N m s/rad", "Weight of the estimated velocity error"),
      gain("observer_kd", &NicosiaTomeiGains::observer_kd, "1/s",
           "Gain of the observer from its error to the velocity estimate"),
      gain("observer_ko", &NicosiaTomeiGains::observer_ko, "N m/rad",
           "Gain of the observer from its error to its torque")};
};

/// Tracking of a rigid robot from link positions alone (`source`). The observer is a model of the
/// robot:
///
///   x1dot = x2 + k_D (q - x1) =: v_hat,
///   x2dot = M(q)^-1 [tau - C(q, v_hat) v_hat - g(q) + KO (q - x1)],
///   tau = M(q) vdot_ref + C(q, v_hat) v_ref + g(q) - Kp e - Kv (v_hat - v_ref).
///
/// The observer's tau is the commanded torque that acts after the delay. With `feedforward_lead_s`,
/// the first two terms use v_ref and vdot_ref at that time ahead; measured and estimated values are
/// not taken ahead.
class NicosiaTomei : public RigidLaw<NicosiaTomeiGains> {
 public:
  static constexpr std::string_view name = "nicosia_tomei";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"v_hat", "rad/s"}};
  static constexpr std::string_view source =
      "S. Nicosia and P. Tomei, Robot control by using only joint position measurements, IEEE "
      "Trans. Automatic Control 35(9), 1990, in the form implemented here";
  static constexpr std::string_view proved = "locally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "observer_kd lambda_min(M) > k_c (sup |v| and what the initial errors add), with |C(q, x) y| "
      "<= k_c |x| |y|; small initial errors, the observer's included; the torque acts as commanded";

  using Measurement = messages::PositionMeasurement;

  struct Memory {
    Vector delta;       ///< q - x1 [rad]
    Vector x2;          ///< [rad/s]
    Vector q_previous;  ///< [rad]
    /// torques commanded at the last tick and the ticks before, as far back as the delay reaches [N
    /// m]; empty before the first step, and beyond the delay
    std::array<Vector, Settings::most_delay + 1> tau;

    static constexpr std::tuple members{&Memory::delta, &Memory::x2, &Memory::q_previous,
                                        &Memory::tau};
  };

  /// Computes gains by which the observer has two poles at the filter's pole.
  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), 2 * t.filter, t.filter * t.filter * t.inertia};
  }

  NicosiaTomei(Robot robot, Gains gains, const Settings& settings)
      : LawOf(std::move(robot), std::move(gains), settings),
        delay_(static_cast<std::size_t>(settings.command_delay)) {
    if (settings.command_delay < 0 || settings.command_delay > Settings::most_delay) {
      throw std::logic_error("nicosia_tomei: no such delay");
    }
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return {Vector::Zero(measured.q.size()), reference.v_ref, measured.q, {}};
  }

  /// @throw std::logic_error if M(q) is not positive definite (see robot::forward_dynamics).
  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    Step<Memory> result{memory, {}, {}};
    Memory& next = result.memory;
    const bool first_step = memory.tau[0].size() == 0;
    if (!first_step) observe(next, measured.q);
    const Vector v_hat = next.x2 + gains_.observer_kd * next.delta;

    const auto [v_ref, a_ref] = ahead(reference);
    result.command.tau = robot::inverse_dynamics_bilinear(robot_, measured.q, v_hat, v_ref, a_ref) -
                         gains_.kp.cwiseProduct(e) -
                         gains_.kv.cwiseProduct(v_hat - reference.v_ref);
    next.q_previous = measured.q;
    // Before the first command, the first command counts as the acting torque.
    for (std::size_t j = 0; j <= delay_; ++j) {
      next.tau[j] = j == 0 || first_step ? result.command.tau : memory.tau[j - 1];
    }
    result.signals = {signals.size(), {e, v_hat}};
    return result;
  }

 private:
  /// Advances delta and x2 by one period, in which q moves linearly from `q_previous` to `q` under
  /// the acting torque. It uses the implicit midpoint rule,
  ///   d = delta + h/2 (qdot - x - k_D d),   x = x2 + h/2 M^-1 [tau - C v_hat - g + KO d],
  /// with (d, x) the midpoint of (delta, x2), and M, C and g at the midpoint of q. The slow term C
  /// v_hat uses v_hat at the period's start. After x is eliminated, the equation is linear in d,
  /// with a positive definite matrix.
  void observe(Memory& memory, const Vector& q) const {
    const double h = settings_.period_s, kd = gains_.observer_kd;
    const Vector advance = q - memory.q_previous;
    const Vector qdot = advance / h;
    const Vector zero = Vector::Zero(q.size());
    const Vector& tau = memory.tau[delay_];
    const Vector q_middle = memory.q_previous + 0.5 * advance;
    const Vector v_hat = memory.x2 + kd * memory.delta;
    const Matrix M = robot::mass_matrix(robot_, q_middle);
    Matrix matrix = (1 + h * kd / 2) * M;
    matrix.diagonal() += h * h / 4 * gains_.observer_ko;
    if (robot::factorise(matrix) >= 0) {
      throw std::logic_error("nicosia_tomei: the inertia matrix is not positive definite");
    }
    Vector middle = M * (memory.delta + h / 2 * (qdot - memory.x2)) +
                    h * h / 4 * (robot::inverse_dynamics(robot_, q_middle, v_hat, zero) - tau);
    robot::solve_in_place(matrix, middle);
    const Vector x2_middle = qdot - kd * middle - 2 / h * (middle - memory.delta);
    memory.x2 = 2 * x2_middle - memory.x2;
    memory.delta = 2 * middle - memory.delta;
  }

  std::size_t delay_;
};

static_assert(OutputFeedbackLaw<NicosiaTomei>);

}  // namespace tachless::controller::law
