// Stability of position actuators by step, against closed forms of one joint.

#include "linear/servo_loop.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/analysis/linear/servo_models.h"

namespace tachless::linear {
namespace {

using namespace linear::testing;

constexpr double M = 0.3;  // of `one_joint`

ServoLoop one(double kp, double kv, double damping = 0) {
  robot::Model model = model_of(one_joint);
  model.damping = Vector::Constant(1, damping);
  return {model, {Vector::Constant(1, kp), Vector::Constant(1, kv), true}, {}};
}

// One joint: z^2 - (2 - a - b) z + 1 - a with a = h kv / M' and b = h^2 kp / M' is stable where
// 2 a + b < 4.
TEST(ServoLoop, OfOneJointIsStableUpToTheStepOfTheClosedForm) {
  for (const double kv : {0.0, 1.0, 10.0, 300.0}) {
    constexpr double kp = 800;
    const double euler = (-kv + std::sqrt(kv * kv + 4 * kp * M)) / kp;
    EXPECT_NEAR(one(kp, kv).limit(ServoStep::euler).step_s / euler, 1, 1e-6) << kv;
    const double implicit = (kv + std::sqrt(kv * kv + 4 * kp * M)) / kp;
    const double limit = one(kp, kv).limit(ServoStep::implicit).step_s;
    if (implicit > longest_servo_step) {
      EXPECT_EQ(limit, infinity);
    } else {
      EXPECT_NEAR(limit / implicit, 1, 1e-6) << kv;
    }
  }
}

TEST(ServoLoop, TakesJointDampingAtTheEndOfEulersStep) {
  constexpr double kp = 800, kv = 30, damping = 20;
  // (M + h d) in the place of M, and d beside kv: h^2 kp + 2 h (kv - d) < 4 M.
  const double difference = kv - damping;
  const double expected = (-difference + std::sqrt(difference * difference + 4 * kp * M)) / kp;
  EXPECT_NEAR(one(kp, kv, damping).limit(ServoStep::euler).step_s / expected, 1, 1e-6);
}

TEST(ServoLoop, HeldByAnOwnLoopNeedsDamping) {
  EXPECT_EQ(one(800, 0).limit(ServoStep::held).step_s, 0);
  // For a joint with kv alone, v+ = (1 - h kv / M) v.
  EXPECT_NEAR(one(0, 30).limit(ServoStep::held).step_s, 2 * M / 30, 1e-8);
  // With kp the held position and velocity have the map [1 - b/2, h (1 - a/2); -b/h, 1 - a], whose
  // determinant is 1 - a + b/2: stable where b < 2 a and a < 2.
  EXPECT_NEAR(one(800, 4).limit(ServoStep::held).step_s, 2 * 4 / 800.0, 1e-8);
}

TEST(ServoLoop, ByRungeKuttaEndsAtItsRealBoundary) {
  EXPECT_NEAR(one(0, 300).limit(ServoStep::rk4).step_s, 2.785293563 * M / 300, 1e-8);
}

TEST(ServoLoop, NamesTheLightJoint) {
  const ServoLoop loop(model_of(light_wrist), gains_of(light_wrist), {});
  for (const ServoStep kind : {ServoStep::euler, ServoStep::rk4, ServoStep::held}) {
    EXPECT_EQ(loop.limit(kind).joint, 3);
    EXPECT_EQ(loop.limit(kind).posture.size(), 4);
  }
  EXPECT_EQ(loop.limit(ServoStep::implicit).step_s, infinity);
}

TEST(ServoLoop, IsStableWithTheArmatureOrKvThatItAsksFor) {
  robot::Model model = model_of(light_wrist);
  ServoGains gains = gains_of(light_wrist);
  const ServoLoop loop(model, gains, {});
  constexpr double step_s = 0.002;
  ASSERT_FALSE(loop.is_stable(ServoStep::euler, step_s));
  const auto armature = loop.least_armature(ServoStep::euler, step_s);
  const auto factor = loop.largest_kv_factor(ServoStep::euler, step_s);
  ASSERT_TRUE(armature && factor);
  ServoGains less = gains;
  less.kv *= *factor;
  EXPECT_NEAR(ServoLoop(model, less, {}).limit(ServoStep::euler).step_s, step_s, 1e-8);
  model.rotor_inertia = Vector::Constant(4, *armature);
  EXPECT_NEAR(ServoLoop(model, gains, {}).limit(ServoStep::euler).step_s, step_s, 1e-8);
}

TEST(ServoLoop, LeavesJointsWithoutActuatorsFree) {
  ServoGains gains = gains_of(light_wrist);
  const robot::Model model = model_of(light_wrist);
  const double all = ServoLoop(model, gains, {}).limit(ServoStep::euler).step_s;
  gains.kp[3] = gains.kv[3] = 0;
  EXPECT_GT(ServoLoop(model, gains, {}).limit(ServoStep::euler).step_s, 3 * all);
}

TEST(ServoLoop, CarriesGravityBesideItsCommand) {
  robot::Model model = model_of(stiff_arm);
  const Vector droop = ServoLoop(model, gains_of(stiff_arm), {}).droop();
  // Gravity at the first joint is at most that of the stretched arm.
  constexpr double most = 9.81 * (2 * 0.2 + 1 * 0.55 + 0.5 * 0.8) / 900;
  EXPECT_LT(droop[0], most);
  EXPECT_GT(droop[0], 0.9 * most);
}

}  // namespace
}  // namespace tachless::linear
