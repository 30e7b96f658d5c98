#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>
#include <string>

#include "plant/arm.h"
#include "robot/dynamics.h"
#include "tests/core/robot/robots.h"

/// Robots, states and an independent integration that these tests share.
namespace tachless::plant::testing {

/// For tests of both.
inline std::string name_of_mechanics(const ::testing::TestParamInfo<Mechanics>& info) {
  return info.param == Mechanics::native ? "native" : "simbody";
}

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double lower, double upper) {
    return lower + (upper - lower) * static_cast<double>(engine_()) / 4294967295.0;
  }
  Vector vector(int size, double bound) {
    Vector x(size);
    for (int i = 0; i < size; ++i) x[i] = (*this)(-bound, bound);
    return x;
  }
  Eigen::Vector3d direction() {
    return Eigen::Vector3d((*this)(-1, 1), (*this)(-1, 1), (*this)(-1, 1)).normalized();
  }
  Eigen::Matrix3d rotation() {
    return Eigen::AngleAxisd((*this)(-3, 3), direction()).toRotationMatrix();
  }

 private:
  std::mt19937 engine_;
};

inline robot::Body random_body(Random& random, int parent, int coordinate) {
  robot::Body body;
  body.parent = parent;
  body.coordinate = coordinate;
  body.R_PB = random.rotation();
  body.p_PB = 0.4 * random.direction();
  body.axis_B = random.direction();
  body.mass = random(0.5, 4);
  body.p_Bcm = 0.2 * random.direction();
  // Principal moments a + b, b + c, c + a satisfy the triangle inequality.
  const double a = random(0.01, 0.1), b = random(0.01, 0.1), c = random(0.01, 0.1);
  const Eigen::Matrix3d R = random.rotation();
  body.I_Bcm = R * Eigen::Vector3d(a + b, b + c, c + a).asDiagonal() * R.transpose();
  return body;
}

inline void finish(robot::Model& model, int num_joints) {
  model.num_joints = num_joints;
  model.gravity = {0.3, -0.4, -9.6};
  model.rotor_inertia = Vector::Zero(num_joints);
}

/// Seven revolute joints about random axes.
inline robot::Model random_chain() {
  Random random(7);
  robot::Model model;
  for (int i = 0; i < 7; ++i) model.bodies.push_back(random_body(random, i - 1, i));
  finish(model, 7);
  return model;
}

/// Two branches, a prismatic joint, and mimic joints of both types, one on the other branch.
inline robot::Model random_tree() {
  Random random(11);
  robot::Model model;
  const int parent[] = {-1, 0, 1, 0, 3, 4, 2};
  const int coordinate[] = {0, 1, 2, 3, 1, 4, 2};
  for (int i = 0; i < 7; ++i) {
    model.bodies.push_back(random_body(random, parent[i], coordinate[i]));
  }
  model.bodies[2].type = robot::JointType::prismatic;
  model.bodies[6].type = robot::JointType::prismatic;
  model.bodies[4].multiplier = -0.7;
  model.bodies[4].offset = 0.3;
  model.bodies[6].multiplier = 1.5;
  model.bodies[6].offset = -0.1;
  finish(model, 5);
  model.rotor_inertia = Vector::Constant(5, 0.05);
  return model;
}

/// One joint about an axis through the centre of mass: I vdot = tau.
inline robot::Model turntable(double inertia) {
  robot::Model model;
  robot::Body disc;
  disc.link = "disc";
  disc.joint = "axle";
  disc.mass = 1;
  disc.I_Bcm = inertia * Eigen::Matrix3d::Identity();
  model.bodies.push_back(disc);
  finish(model, 1);
  model.joint_names = {"axle"};
  model.joint_types = {robot::JointType::revolute};
  model.frames["disc"].body = 0;
  return model;
}

inline ArmState rigid_state(const Vector& q, const Vector& v) {
  ArmState state;
  state.q = q;
  state.v = v;
  return state;
}

/// The classical Runge-Kutta method in `steps` equal steps; `rate(y)` is dy/dt.
template <class Rate>
Eigen::VectorXd runge_kutta_4(const Rate& rate, Eigen::VectorXd y, double interval, int steps) {
  const double h = interval / steps;
  for (int i = 0; i < steps; ++i) {
    const Eigen::VectorXd k1 = rate(y);
    const Eigen::VectorXd k2 = rate(Eigen::VectorXd(y + h / 2 * k1));
    const Eigen::VectorXd k3 = rate(Eigen::VectorXd(y + h / 2 * k2));
    const Eigen::VectorXd k4 = rate(Eigen::VectorXd(y + h * k3));
    y += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  }
  return y;
}

}  // namespace tachless::plant::testing
