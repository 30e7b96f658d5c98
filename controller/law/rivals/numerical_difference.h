#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <tuple>

#include "controller/law/rivals/estimated_velocity.h"

namespace tachless::controller::law {

/// The estimate v_hat = (q_k - q_{k-m}) / (m h). The position of a missed tick lies on the straight
/// line between the measured positions before and after it. Positions before the first one lie on a
/// line of slope v_ref.
class PositionDifference {
 public:
  static constexpr int most_samples = 64;

  struct Memory {
    std::array<Vector, most_samples + 1> q;  ///< newest first; empty beyond m [rad]

    static constexpr std::tuple members{&Memory::q};
  };

  struct Gains {
    Vector kp, kd;
    int samples = 1;

    static constexpr std::tuple keys{
        gain("kp", &Gains::kp, "N m/rad", "Weight of the position error"),
        gain("kd", &Gains::kd, "N m s/rad", "Weight of v_hat - v_ref"),
        base::Key{"samples", &Gains::samples, "ticks", "m: over how many periods the difference is"}
            .in({1, most_samples})};
  };

  /// Computes gains with the lag of the filter: a difference over m periods lags by m h / 2, a
  /// filter by 1 / its pole.
  static Gains tuned(const Tuning& t) {
    const double samples = std::round(2 / (t.filter * t.period_s));
    return {t.kp(), t.kd(), static_cast<int>(std::clamp(samples, 1.0, most_samples * 1.0))};
  }

  PositionDifference(const Gains& gains, const Settings& settings)
      : m_(static_cast<std::size_t>(gains.samples)), period_s_(settings.period_s) {}

  [[nodiscard]] Memory start(const Vector& q, const ReferencePoint& reference) const {
    Memory memory;
    for (std::size_t j = 0; j <= m_; ++j) {
      memory.q[j] = q - static_cast<double>(j + 1) * period_s_ * reference.v_ref;
    }
    return memory;
  }

  [[nodiscard]] Memory step(const Memory& memory, const Vector& q) const {
    Memory next;
    next.q[0] = q;
    for (std::size_t j = 1; j <= m_; ++j) next.q[j] = memory.q[j - 1];
    return next;
  }

  [[nodiscard]] Vector velocity(const Memory& memory) const {
    return (memory.q[0] - memory.q[m_]) / (static_cast<double>(m_) * period_s_);
  }

 private:
  std::size_t m_;
  double period_s_;
};

/// `EstimatedVelocity` by a difference of positions. Most controllers without a tachometer use it;
/// section 1 of Loria and Ortega (1995) argues against it. With counts of width Delta, |v_hat - v|
/// <= Delta / (m h) + (m h / 2) sup |vdot|.
class NumericalDifference : public EstimatedVelocity<PositionDifference> {
 public:
  static constexpr std::string_view name = "numerical_difference";
  static constexpr std::string_view source =
      "common practice: the control law of J. T. Wen and D. S. Bayard, Int. J. of Control 47(5), "
      "1988, eq. 4.2, with a difference of positions for the velocity";
  static constexpr std::string_view proved = "nothing of the sampled loop; wen_bayard as m h -> 0";
  static constexpr std::string_view conditions =
      "those of wen_bayard, and m h short beside the loop; the error of v_hat is at most Delta / "
      "(m h) + (m h / 2) sup |vdot| with counts of width Delta, least at m h = sqrt(2 Delta / sup "
      "|vdot|)";

  using EstimatedVelocity::EstimatedVelocity;
};

static_assert(OutputFeedbackLaw<NumericalDifference>);

}  // namespace tachless::controller::law
