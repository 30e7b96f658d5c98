#pragma once

#include <Eigen/LU>
#include <cstddef>
#include <stdexcept>
#include <string_view>
#include <tuple>
#include <vector>

#include "controller/law/rivals/estimated_velocity.h"

namespace tachless::controller::law {

/// Steady-state Kalman filter of each joint's position. Its model is a chain of 2 (3) integrators.
/// White noise of spectral density Q drives the chain as acceleration (jerk). The position is
/// observed every period with the variance R = measurement_noise^2.
class KalmanChain {
 public:
  struct Memory {
    Vector q, v, a;  ///< at the last sample [rad], [rad/s], [rad/s^2]; a is empty if order is 2

    static constexpr std::tuple members{&Memory::q, &Memory::v, &Memory::a};
  };

  struct Gains {
    Vector kp, kd, process_noise;
    int order = 2;
    Vector measurement_noise;

    static constexpr std::tuple keys{
        gain("kp", &Gains::kp, "N m/rad", "Weight of the position error"),
        gain("kd", &Gains::kd, "N m s/rad", "Weight of v_hat - v_ref"),
        gain("process_noise", &Gains::process_noise, "rad^2/s^3; with order 3 rad^2/s^5",
             "Q: spectral density of the acceleration; with order 3 of the jerk"),
        base::Key{"order", &Gains::order, "integrators", "Length of the chain"}.in({2, 3}),
        gain("measurement_noise", &Gains::measurement_noise, "rad",
             "Standard deviation of a measured position")
            .by_default("that of the scenario's encoder: one count / sqrt(12), and its noise")};
  };

  /// Computes gains by which the estimate's two poles are at sqrt(2) times the filter's pole, so
  /// that both have the same lag. Only the ratio of the two noises matters, so the measurement
  /// noise is set to 1.
  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), t.each(4 * t.filter * t.filter * t.filter * t.filter * t.period_s), 2,
            t.each(1)};
  }

  /// @throw std::invalid_argument if measurement_noise is not given and the encoder is ideal.
  KalmanChain(const Gains& gains, const Settings& settings)
      : order_(gains.order), period_s_(settings.period_s) {
    const Vector& noise =
        gains.measurement_noise.size() > 0 ? gains.measurement_noise : settings.position_std;
    if (noise.size() == 0 || !(noise.array() > 0).all()) {
      throw std::invalid_argument(
          "measurement_noise is missing, and the encoder is ideal: a Kalman filter needs to know "
          "how far measured positions are off; give it, or plant.encoder.resolution_bits");
    }
    gains_.reserve(static_cast<std::size_t>(noise.size()));
    for (Eigen::Index i = 0; i < noise.size(); ++i) {
      // In units of periods and standard deviations, Q, R and h reduce to one number.
      const double h = period_s_;
      const double h_to_2_order_less_1 = order_ == 2 ? h * h * h : h * h * h * h * h;
      const double Q = gains.process_noise[i] * h_to_2_order_less_1 / (noise[i] * noise[i]);
      gains_.push_back(steady_gain(Q));
    }
  }

  [[nodiscard]] Memory start(const Vector& q, const ReferencePoint& reference) const {
    const Vector a = order_ == 3 ? reference.a_ref : Vector();
    return predicted({q, reference.v_ref, a}, -period_s_);
  }

  [[nodiscard]] Memory step(const Memory& memory, const Vector& q) const {
    Memory next = predicted(memory, period_s_);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const Small& gain = gains_[static_cast<std::size_t>(i)];
      const double surprise = q[i] - next.q[i];
      next.q[i] += gain(0) * surprise;
      next.v[i] += gain(1) / period_s_ * surprise;
      if (order_ == 3) next.a[i] += gain(2) / (period_s_ * period_s_) * surprise;
    }
    return next;
  }

  [[nodiscard]] Vector velocity(const Memory& memory) const { return memory.v; }

 private:
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 3, 3>;

  [[nodiscard]] Memory predicted(const Memory& from, double time_s) const {
    if (order_ == 2) return {from.q + time_s * from.v, from.v, {}};
    return {from.q + time_s * (from.v + time_s / 2 * from.a), from.v + time_s * from.a, from.a};
  }

  /// Returns F of x(t + 1) = F x(t), with time in periods.
  [[nodiscard]] Small transition() const {
    Small F = Small::Identity(order_, order_);
    F(0, 1) = 1;
    if (order_ == 3) {
      F(0, 2) = 1.0 / 2;
      F(1, 2) = 1;
    }
    return F;
  }

  /// Returns the covariance that white noise of density Q adds in a period.
  [[nodiscard]] Small added_covariance(double Q) const {
    Small added(order_, order_);
    if (order_ == 2) {
      added << 1.0 / 3, 1.0 / 2, 1.0 / 2, 1;
    } else {
      added << 1.0 / 20, 1.0 / 8, 1.0 / 6, 1.0 / 8, 1.0 / 3, 1.0 / 2, 1.0 / 6, 1.0 / 2, 1;
    }
    return Q * added;
  }

  /// Returns the steady-state covariance before a sample. P = F (P^-1 + C' C)^-1 F' + Q is solved
  /// by doubling (B. D. O. Anderson, Int. J. of Control 28(2), 1978): iteration k covers 2^k
  /// periods.
  [[nodiscard]] Small steady_prediction(double Q) const {
    constexpr int most_doublings = 64;
    const Small one = Small::Identity(order_, order_);
    Small A = transition().transpose(), G = Small::Zero(order_, order_), P = added_covariance(Q);
    G(0, 0) = 1;
    for (int k = 0; k < most_doublings; ++k) {
      const Small inverse = (one + G * P).inverse();
      const Small added = A.transpose() * P * inverse * A;
      G += A * inverse * G * A.transpose();
      A = A * inverse * A;
      P += added;
      if ((added.diagonal().array() <= 1e-15 * P.diagonal().array()).all()) break;
    }
    return P;
  }

  [[nodiscard]] static Small corrected(const Small& P) {
    return P - P.col(0) * P.row(0) / (P(0, 0) + 1);
  }

  [[nodiscard]] Small steady_gain(double Q) const {
    const Small F = transition();
    const Small P = F * corrected(steady_prediction(Q)) * F.transpose() + added_covariance(Q);
    return P.col(0) / (P(0, 0) + 1);
  }

  int order_;
  double period_s_;
  /// Filter gains of each joint, in units of the period and of the measurement's standard
  /// deviation.
  std::vector<Small> gains_;
};

/// `EstimatedVelocity` with a Kalman filter (`source`), in the form implemented here. The filter
/// treats counts of width Delta as white noise of variance Delta^2 / 12. This assumption fails if
/// the robot moves less than some counts per period.
class KalmanVelocity : public EstimatedVelocity<KalmanChain> {
 public:
  static constexpr std::string_view name = "kalman_velocity";
  static constexpr std::string_view source =
      "P. R. Belanger, Estimation of angular velocity and acceleration from shaft encoder "
      "measurements, IEEE Int. Conf. Robotics and Automation, 1992, as velocity source of the "
      "control law of Wen and Bayard (1988)";
  static constexpr std::string_view proved =
      "least variance of v_hat, for white noise that drives and disturbs; nothing of the loop";
  static constexpr std::string_view conditions =
      "those of wen_bayard, and a filter fast beside the loop; counts are taken for white noise, "
      "which is wrong on slow motion";

  using EstimatedVelocity::EstimatedVelocity;
};

static_assert(OutputFeedbackLaw<KalmanVelocity>);

}  // namespace tachless::controller::law
