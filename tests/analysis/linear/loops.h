#pragma once

#include <cmath>

#include "lyapunov/error_system.h"
#include "lyapunov/norm_conditions.h"
#include "tests/core/robot/robots.h"

/// The loops whose numbers the tests quote.
namespace tachless::linear::testing {

inline Eigen::VectorXd both(double joint_1, double joint_2) {
  return Eigen::Vector2d(joint_1, joint_2);
}
inline Eigen::VectorXd both(double value) { return both(value, value); }

/// Largest |v_ref| of the paper's reference, sin(10 pi t) / (10 pi) on both joints.
inline const double paper_B_d = std::sqrt(2.0);

inline controller::law::FilterGains paper_rigid() {
  return {both(5000, 6000), both(7000, 8800), both(1000), both(1000)};
}
inline controller::law::FilterGains practical_rigid() {
  return {both(40000, 2400), both(1000, 60), both(1000), both(1000)};
}
inline Eigen::VectorXd stiffness() { return both(1e4); }
inline Eigen::VectorXd rotors() { return both(0.1); }
inline controller::law::FilterGains paper_flexible() {
  return {both(1e4), both(7000, 8800), both(1000), both(1000)};  // of links and motors alike
}
inline controller::law::FilterGains practical_link() {
  return {both(20000, 1500), both(600, 30), both(250), both(250)};
}
inline controller::law::FilterGains practical_motor() {
  return {both(100), both(13, 20), both(1000), both(1000)};
}

inline lyapunov::ErrorSystem rigid(const controller::law::FilterGains& gains) {
  return {gains.kp.asDiagonal(), gains.kd.asDiagonal(), gains.a, gains.b, {}};
}
inline lyapunov::ErrorSystem flexible(const controller::law::FilterGains& link,
                                      const controller::law::FilterGains& motor) {
  return lyapunov::flexible_error_system(stiffness(), rotors(), link, motor);
}

/// Seven joints as in scenarios/iiwa_point_to_point.yaml.
inline controller::law::FilterGains iiwa_gains() {
  controller::law::FilterGains gains;
  gains.kp.resize(7);
  gains.kp << 600, 1500, 150, 500, 15, 20, 1;
  gains.kd.resize(7);
  gains.kd << 40, 100, 8, 30, 0.8, 1.2, 0.05;
  gains.a.setConstant(7, 200);
  gains.b.setConstant(7, 200);
  return gains;
}

}  // namespace tachless::linear::testing
