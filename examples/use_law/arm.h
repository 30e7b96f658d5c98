#pragma once

#include <array>
#include <cmath>
#include <cstdint>

// Plays the arm of two_link.urdf, without friction, so that the example runs without one. A torque
// acts a tick after it was sent.
class Arm {
 public:
  explicit Arm(double period_s) : h_(period_s / steps) {}

  const std::array<double, 2>& positions() const { return q_; }
  template <class Torques>
  void send(const Torques& tau) {
    for (int i = 0; i < steps; ++i) move();
    tau_ = {tau[0], tau[1]};
  }
  void brake() { tau_ = v_ = {0, 0}; }

 private:
  static constexpr int steps = 20;

  void move() {
    const double c = 0.51 * std::cos(q_[1]), s = 0.51 * std::sin(q_[1]);
    const double m11 = 8.77 + 2 * c, m12 = 0.76 + c, m22 = 0.62,
                 far = 0.63 * std::sin(q_[0] + q_[1]);
    const double b1 =
        tau_[0] + s * v_[1] * (2 * v_[0] + v_[1]) - 9.81 * (7.6 * std::sin(q_[0]) + far);
    const double b2 = tau_[1] - s * v_[0] * v_[0] - 9.81 * far;
    const double det = m11 * m22 - m12 * m12;
    v_[0] += h_ * (m22 * b1 - m12 * b2) / det;
    v_[1] += h_ * (m11 * b2 - m12 * b1) / det;
    for (int i = 0; i < 2; ++i) q_[i] += h_ * v_[i];
  }

  double h_;
  std::array<double, 2> q_{0, 0}, v_{0, 0}, tau_{0, 0};
};
