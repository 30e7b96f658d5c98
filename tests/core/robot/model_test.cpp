#include "robot/model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <stdexcept>

#include "tests/core/robot/robots.h"

namespace tachless::robot {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string complaint(const Model& model, double mass, const std::string& link) {
  try {
    (void)with_payload(model, {.mass = mass}, link);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "accepted";
}

TEST(Posture, IsNearestToZeroAndInRangeWhereAJointHasLimits) {
  const auto both = [](double a, double b) {
    Vector q(2);
    q << a, b;
    return q;
  };
  Model model = testing::two_link();
  const double none = Model::unlimited;
  model.lower = both(-none, 0.5);
  model.upper = both(none, 2);
  EXPECT_EQ(nearest_to_zero(model), both(0, 0.5));
  EXPECT_EQ(finite_range(model, 0), std::pair(-std::numbers::pi, std::numbers::pi));
  EXPECT_EQ(finite_range(model, 1), std::pair(0.5, 2.0));
  model.upper[1] = none;
  EXPECT_EQ(finite_range(model, 1), std::pair(0.5, 0.5 + std::numbers::pi));
  model.joint_types[0] = JointType::prismatic;
  model.upper[0] = -7;
  EXPECT_EQ(finite_range(model, 0), std::pair(-8.0, -7.0));
}

TEST(Payload, HangsOnTheFarthestLeafByDefault) {
  const Model model = testing::load("scenarios/robots/two_link.urdf");
  const Model by_default = with_payload(model, {.mass = 0.5}),
              by_name = with_payload(model, {.mass = 0.5}, "tip");
  const Body& link2 = by_default.bodies[1];
  EXPECT_EQ(link2.link, "link2");
  EXPECT_EQ(link2.mass, 2.2);
  EXPECT_EQ(link2.p_Bcm, by_name.bodies[1].p_Bcm);
  // (1.7 * 0.3 + 0.5) / 2.2, and 0.307 + (1.7 * 0.5 / 2.2) 0.7^2: one rounding or two each.
  EXPECT_NEAR(link2.p_Bcm.z(), -1.01 / 2.2, 1e-15);
  EXPECT_NEAR(link2.I_Bcm(1, 1), 0.307 + 1.7 * 0.5 / 2.2 * 0.49, 1e-15);
  EXPECT_EQ(by_default.bodies[0].mass, model.bodies[0].mass);
}

TEST(Payload, OfNoMassChangesNothing) {
  const Model model = testing::two_link(), same = with_payload(model, {.mass = 0});
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    EXPECT_EQ(same.bodies[i].mass, model.bodies[i].mass);
    EXPECT_EQ(same.bodies[i].p_Bcm, model.bodies[i].p_Bcm);
    EXPECT_EQ(same.bodies[i].I_Bcm, model.bodies[i].I_Bcm);
  }
}

TEST(MassProperties, OfTwoInertiasWithoutMassAreTheirSum) {
  const Eigen::Matrix3d one = Eigen::Vector3d(1, 2, 3).asDiagonal();
  const Eigen::Matrix3d other = Eigen::Vector3d(2, 2, 1).asDiagonal();
  const MassProperties both = combine({0, {1, 0, 0}, one}, {0, {2, 0, 0}, other});
  EXPECT_EQ(both.mass, 0);
  EXPECT_EQ(both.p_Bcm, Eigen::Vector3d(1, 0, 0));
  EXPECT_EQ(both.I_Bcm, one + other);
}

TEST(MassProperties, AreToTheLastBitTheSameWithNothingAdded) {
  const MassProperties some{3, {0.1, 0, 0}, Eigen::Matrix3d::Identity()};
  ASSERT_NE((some.mass * some.p_Bcm / some.mass).x(), some.p_Bcm.x());
  EXPECT_EQ(combine({}, some).p_Bcm, some.p_Bcm);
  EXPECT_EQ(combine(some, {}).p_Bcm, some.p_Bcm);
  const MassProperties kilogram{1, {1, 0, 0}, Eigen::Matrix3d::Zero()};
  EXPECT_EQ(combine(kilogram, some).mass, 4);
  EXPECT_EQ(combine(some, kilogram).mass, 4);
}

TEST(MassProperties, AreNotPhysicalWhereAnyNumberIsNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  EXPECT_EQ(why_not_physical({1, {0, 0, 0}, I}), "");
  EXPECT_THAT(why_not_physical({nan, {0, 0, 0}, I}), HasSubstr("mass nan kg"));
  EXPECT_THAT(why_not_physical({1, {0, nan, 0}, I}), HasSubstr("not finite"));
  EXPECT_THAT(why_not_physical({1, {0, 0, 0}, nan * I}), HasSubstr("not finite"));
}

TEST(Payload, PrefersMoreJointsOverMoreMetres) {
  // The claw hangs by three joints (turn, arm, finger, claw: four), the hand by three.
  const Model loaded = with_payload(testing::branching(), {.mass = 1});
  EXPECT_EQ(loaded.bodies.back().link, "claw");
  EXPECT_EQ(loaded.bodies.back().mass, 1.2);
}

TEST(Payload, IsRefusedWhereItMakesNoSense) {
  const Model model = testing::branching();
  EXPECT_THAT(complaint(model, -1, "claw"), HasSubstr("mass -1 kg"));
  EXPECT_THAT(complaint(model, std::numeric_limits<double>::infinity(), "claw"),
              HasSubstr("mass inf kg"));
  EXPECT_THAT(complaint(model, 1, "nose"), HasSubstr("no link 'nose'"));
  EXPECT_THAT(complaint(model, 1, "nose"), HasSubstr("claw"));
  EXPECT_THAT(complaint(model, 1, "pedestal"), HasSubstr("'pedestal' is fixed to the ground"));
}

TEST(Payload, TakesEitherOfTwoToolFramesAtOnePlace) {
  std::string urdf = testing::chain_urdf(1);
  urdf.insert(urdf.find("</robot>"),
              "<link name='flange'/><link name='tool0'/><joint name='a' type='fixed'><parent "
              "link='l1'/><child link='flange'/></joint><joint name='b' type='fixed'><parent "
              "link='l1'/><child link='tool0'/><origin rpy='0 1 0'/></joint>");
  const Model model = model_from_urdf(urdf, "t");
  EXPECT_EQ(with_payload(model, {.mass = 1}).bodies[0].mass, model.bodies[0].mass + 1);
  EXPECT_THAT(farthest_leaves(model), ElementsAre("flange"));
}

TEST(Payload, WantsALinkNamedWhereTwoAreEquallyFar) {
  const std::string mass =
      "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' "
      "iyz='0'/></inertial>";
  std::string urdf = "<robot name='t'><link name='base'/>";
  for (const std::string side : {"left", "right"}) {
    urdf += "<link name='" + side + "'>" + mass + "</link><joint name='" + side +
            "_joint' type='continuous'><parent link='base'/><child link='" + side +
            "'/><origin xyz='0 " + (side == "left" ? "1" : "-1.0000000015") +
            " 0'/></joint>";  // but for rounding
  }
  const Model model = model_from_urdf(urdf + "</robot>", "t.urdf");
  EXPECT_THAT(complaint(model, 1, ""), HasSubstr("'left' and 'right'"));
  EXPECT_THAT(farthest_leaves(model), ElementsAre("left", "right"));
  EXPECT_EQ(with_payload(model, {.mass = 1}, "right").bodies[1].mass, 2);
}

}  // namespace
}  // namespace tachless::robot
