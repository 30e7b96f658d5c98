#include "robot/typical_rotors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

namespace tachless::robot {
namespace {

using ::testing::HasSubstr;

std::string joint(const std::string& type, const std::string& limit) {
  return "<robot name='r'><link name='base'/><link name='arm'><inertial><mass value='1'/>"
         "<inertia ixx='0.1' iyy='0.1' izz='0.1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
         "<joint name='axis' type='" +
         type + "'><parent link='base'/><child link='arm'/><axis xyz='0 0 1'/>" + limit +
         "</joint></robot>";
}

TEST(TypicalRotors, FollowTheEffortLimit) {
  const Model arm = model_from_urdf(
      joint("revolute", "<limit lower='-1' upper='1' effort='87' velocity='2'/>"), "r.urdf");
  EXPECT_DOUBLE_EQ(typical_rotor_inertia(arm)[0], 0.26);
}

TEST(TypicalRotors, AreNoneOfAPrismaticJoint) {
  const Model lift = model_from_urdf(
      joint("prismatic", "<limit lower='-1' upper='1' effort='87' velocity='2'/>"), "r.urdf");
  EXPECT_EQ(typical_rotor_inertia(lift)[0], 0);
}

TEST(TypicalRotors, NeedAnEffortLimit) {
  const Model arm = model_from_urdf(
      joint("revolute", "<limit lower='-1' upper='1' effort='0' velocity='2'/>"), "r.urdf");
  try {
    (void)typical_rotor_inertia(arm);
    ADD_FAILURE() << "no effort limit, and no refusal";
  } catch (const std::invalid_argument& refused) {
    EXPECT_THAT(refused.what(), HasSubstr("joint axis has no effort limit"));
  }
}

}  // namespace
}  // namespace tachless::robot
