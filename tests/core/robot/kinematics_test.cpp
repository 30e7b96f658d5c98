#include "robot/kinematics.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "robot/dynamics.h"
#include "tests/core/robot/energy.h"
#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"

namespace tachless::robot {
namespace {

using testing::Random;

TEST(FramePose, PutsTheTipOfTheTwoLinkArmWhereTrigonometryDoes) {
  const Model model = testing::two_link();
  Random random(1);
  for (int k = 0; k < 100; ++k) {
    const Vector q = random.vector(2, 3);
    const Eigen::Vector3d expected(std::sin(q[0]) + std::sin(q[0] + q[1]), 0,
                                   -std::cos(q[0]) - std::cos(q[0] + q[1]));
    EXPECT_LT((link_position(model, "tip", q) - expected).norm(), 16 * eps);
  }
}

TEST(FramePose, HasTheIiwaUprightAtItsHeight) {
  const Vector q = Vector::Zero(7);
  const Eigen::Vector3d flange = link_position(testing::iiwa7(), "flange", q);
  // Sum of the segments along z: 1.306 m; angles of the file are pi to the last bit or so.
  EXPECT_LT((flange - Eigen::Vector3d(0, 0, 1.306)).norm(), 1e-14);
}

TEST(FramePose, MovesAsTheKineticAndPotentialEnergyOfAPayloadSay) {
  const Model model = testing::branching();
  Random random(2);
  for (const char* link : {"plate", "hand", "claw"}) {
    const Model loaded = with_payload(model, {.mass = 2}, link);
    for (int k = 0; k < 20; ++k) {
      const Vector q = random.vector(4, 1), v = random.vector(4, 2);
      const Vector3Of<Jet2> p = testing::moving_pose(model, model.frames.at(link), q, v).p;
      const Eigen::Vector3d at(p[0].value, p[1].value, p[2].value);
      EXPECT_LT((at - link_position(model, link, q)).norm(), 64 * eps);
      const Eigen::Vector3d rate(p[0].first, p[1].first, p[2].first);
      // Energies to 100 J.
      EXPECT_NEAR(testing::kinetic_energy(loaded, q, v) - testing::kinetic_energy(model, q, v),
                  rate.squaredNorm(), 64 * eps * 100);
      EXPECT_NEAR(potential_energy(loaded, q) - potential_energy(model, q), 2 * 9.81 * p[2].value,
                  64 * eps * 300);
    }
  }
}

TEST(ForceTorque, HasThePowerOfTheForce) {
  const Model model = testing::branching();
  Random random(7);
  for (const char* link : {"plate", "hand", "claw"}) {
    const Frame& frame = model.frames.at(link);
    for (int k = 0; k < 20; ++k) {
      const Vector q = random.vector(4, 1), v = random.vector(4, 2);
      const Eigen::Vector3d p_F = random.vector(3, 0.5), force = random.vector(3, 10);
      const Pose<Jet2> X = testing::moving_pose(model, frame, q, v);
      double power = 0;
      for (int i = 0; i < 3; ++i) {
        power += force[i] * (X.p[i].first + X.R(i, 0).first * p_F[0] + X.R(i, 1).first * p_F[1] +
                             X.R(i, 2).first * p_F[2]);
      }
      EXPECT_NEAR(force_torque(model, frame, p_F, force, q).dot(v), power, 64 * eps * 100);
    }
  }
}

TEST(FramePose, TurnsMimicsByMultiplierAndOffset) {
  const Model model = testing::branching();
  const Vector q = Random(4).vector(4, 1);
  const double lift = q[1], finger_joint = -0.5 * lift + 0.1, claw_joint = 4 * finger_joint - 0.3;
  const Pose<double> boom = frame_pose(model, "boom", q), finger = frame_pose(model, "finger", q),
                     claw = frame_pose(model, "claw", q);
  const Eigen::Vector3d p = boom.R.transpose() * (finger.p - boom.p);
  const Eigen::Vector3d slid(0.6 - std::sin(0.3) * finger_joint, std::cos(0.3) * finger_joint, 0);
  EXPECT_LT((p - slid).norm(), 32 * eps);
  const Eigen::Matrix3d turned = (Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(claw_joint, Eigen::Vector3d::UnitZ()))
                                     .toRotationMatrix();
  EXPECT_LT((finger.R.transpose() * claw.R - turned).norm(), 32 * eps);
}

TEST(FramePose, IsARotationAndPlacesTheGroundsFramesToo) {
  const Model model = testing::branching();
  const Vector q = Random(3).vector(4, 2);
  const Pose<double> claw = frame_pose(model, "claw", q);
  EXPECT_LT((claw.R * claw.R.transpose() - Eigen::Matrix3d::Identity()).norm(), 32 * eps);
  EXPECT_NEAR(claw.R.determinant(), 1, 32 * eps);
  EXPECT_EQ(link_position(model, "pedestal", q), Eigen::Vector3d(0.1, 0.2, 0.5));
  EXPECT_EQ(link_position(model, "base", q), Eigen::Vector3d(0, 0, 0));
}

TEST(FramePose, RefusesAnUnknownLink) {
  const Model model = testing::two_link();
  EXPECT_THROW(link_position(model, "nose", Vector::Zero(2)), std::invalid_argument);
}

}  // namespace
}  // namespace tachless::robot
