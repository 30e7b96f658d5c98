#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <limits>
#include <locale>
#include <stdexcept>
#include <string>
#include <vector>

#include "robot/dynamics.h"
#include "robot/kinematics.h"
#include "robot/model.h"
#include "robot/urdf_xml.h"
#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"

namespace tachless::robot {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

constexpr double inf = Model::unlimited;

std::vector<double> list(const Vector& x) { return {x.data(), x.data() + x.size()}; }

const Body& body_of(const Model& model, std::string_view joint) {
  for (const Body& body : model.bodies) {
    if (body.joint == joint) return body;
  }
  throw std::runtime_error("no joint " + std::string(joint));
}

TEST(Urdf, NumbersCoordinatesAndBodiesDepthFirstInTheOrderOfTheFile) {
  const Model model = testing::branching();
  EXPECT_EQ(model.num_joints, 4);
  // plate_mount comes before the trunk's other joints, so what hangs on the plate comes first;
  // names are in no alphabetical order.
  EXPECT_THAT(model.joint_names, ElementsAre("turn", "lift", "wrist", "arm"));
  std::vector<std::string> joints;
  for (const Body& body : model.bodies) joints.push_back(body.joint);
  EXPECT_THAT(joints,
              ElementsAre("turn", "lift", "wrist", "early", "arm", "finger_joint", "claw_joint"));
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    EXPECT_LT(model.bodies[i].parent, static_cast<int>(i));
  }
  EXPECT_THAT(model.joint_types, ElementsAre(JointType::revolute, JointType::prismatic,
                                             JointType::revolute, JointType::revolute));
}

TEST(Urdf, ReadsLimitsAndTakesZeroEffortAndVelocityForNone) {
  const Model model = testing::branching();
  EXPECT_THAT(list(model.lower), ElementsAre(-2.5, -0.4, -1, -inf));
  EXPECT_THAT(list(model.upper), ElementsAre(2, 0.4, 1, inf));
  EXPECT_THAT(list(model.effort_limit), ElementsAre(120, inf, 20, inf));
  EXPECT_THAT(list(model.velocity_limit), ElementsAre(3, 0.5, inf, inf));
  EXPECT_THAT(list(model.rotor_inertia), ElementsAre(0, 0, 0, 0));
  EXPECT_EQ(model.gravity, Eigen::Vector3d(0, 0, -9.81));
}

TEST(Urdf, ResolvesMimicsOfLaterJointsOfOtherKindsAndOfMimics) {
  const Model model = testing::branching();
  const Body& early = body_of(model, "early");
  EXPECT_EQ(early.coordinate, 2);
  EXPECT_EQ(early.multiplier, 3);
  EXPECT_EQ(early.offset, 0);
  const Body& finger = body_of(model, "finger_joint");
  EXPECT_EQ(finger.coordinate, 1);
  EXPECT_EQ(finger.type, JointType::prismatic);
  EXPECT_EQ(finger.multiplier, -0.5);
  EXPECT_EQ(finger.offset, 0.1);
  const Body& claw = body_of(model, "claw_joint");  // 4 (-0.5 lift + 0.1) - 0.3
  EXPECT_EQ(claw.coordinate, 1);
  EXPECT_EQ(claw.type, JointType::revolute);
  EXPECT_EQ(claw.multiplier, -2);
  EXPECT_NEAR(claw.offset, 0.1, eps);
}

TEST(Urdf, TakesOneAndZeroForAMimicsMissingMultiplierAndOffset) {
  std::string text = testing::chain_urdf(2, 1);
  const std::string from = "multiplier='0.5'";
  text.replace(text.find(from), from.size(), "");
  const Model model = model_from_urdf(text, "chain");
  EXPECT_EQ(model.bodies[2].multiplier, 1);
  EXPECT_EQ(model.bodies[2].offset, 0);
}

TEST(Urdf, MergesFixedLinksIntoTheBodyTheyAreFixedTo) {
  const Model model = testing::branching();
  const Body& trunk = body_of(model, "turn");
  EXPECT_EQ(trunk.link, "trunk");
  EXPECT_EQ(trunk.mass, 7.5);
  // The first and second moments of mass of the two links, by hand in the trunk's frame.
  const auto rpy = [](double r, double p, double y) {
    return (Eigen::AngleAxisd(y, Eigen::Vector3d::UnitZ()) *
            Eigen::AngleAxisd(p, Eigen::Vector3d::UnitY()) *
            Eigen::AngleAxisd(r, Eigen::Vector3d::UnitX()))
        .toRotationMatrix();
  };
  const auto about_origin = [](double m, const Eigen::Vector3d& c, const Eigen::Matrix3d& I) {
    return Eigen::Matrix3d(I +
                           m * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose()));
  };
  const Eigen::Matrix3d R_trunk = rpy(0.5, 0.1, -0.7), R_plate = rpy(1.1, -0.4, 0.2),
                        R_inertial = R_plate * rpy(0.2, 0.3, 0.4);
  Eigen::Matrix3d I_trunk, I_plate;
  I_trunk << 0.11, 0.01, -0.02, 0.01, 0.13, 0.005, -0.02, 0.005, 0.07;
  I_plate << 0.01, 0.001, 0, 0.001, 0.012, -0.002, 0, -0.002, 0.02;
  const Eigen::Vector3d c_trunk(0.02, -0.03, 0.2);
  const Eigen::Vector3d c_plate =
      Eigen::Vector3d(0.1, 0, 0.4) + R_plate * Eigen::Vector3d(0.03, 0.01, -0.02);
  EXPECT_LT((trunk.mass * trunk.p_Bcm - (6 * c_trunk + 1.5 * c_plate)).norm(), 16 * eps);
  const Eigen::Matrix3d expected =
      about_origin(6, c_trunk, R_trunk * I_trunk * R_trunk.transpose()) +
      about_origin(1.5, c_plate, R_inertial * I_plate * R_inertial.transpose());
  EXPECT_LT((about_origin(trunk.mass, trunk.p_Bcm, trunk.I_Bcm) - expected).norm(), 32 * eps);
  EXPECT_EQ(trunk.I_Bcm, trunk.I_Bcm.transpose());
}

TEST(Urdf, KeepsAFrameForEveryLinkAndSaysWhichAreLeaves) {
  const Model model = testing::branching();
  EXPECT_EQ(model.frames.size(), 10u);
  EXPECT_EQ(model.frames.at("base").body, -1);
  EXPECT_EQ(model.frames.at("pedestal").body, -1);
  EXPECT_EQ(model.frames.at("plate").body, model.frames.at("trunk").body);
  EXPECT_EQ(model.frames.at("plate").p_BF, Eigen::Vector3d(0.1, 0, 0.4));
  EXPECT_FALSE(model.frames.at("plate").leaf);
  EXPECT_TRUE(model.frames.at("hand").leaf);
  EXPECT_FALSE(model.frames.at("finger").leaf);
}

TEST(Urdf, NormalisesAnAxisAndTakesXForAMissingOne) {
  const Model model = testing::branching();
  EXPECT_LT((body_of(model, "lift").axis_B - Eigen::Vector3d(0, 1, 3) / std::sqrt(10.0)).norm(),
            2 * eps);
  const Model plain = model_from_urdf(
      "<robot name='t'><link name='a'/><link name='b'><inertial><mass value='1'/><inertia ixx='1' "
      "iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='j' "
      "type='continuous'><parent link='a'/><child link='b'/></joint></robot>",
      "t");
  EXPECT_EQ(plain.bodies[0].axis_B, Eigen::Vector3d::UnitX());
}

TEST(Urdf, ReadsTheSameNumbersUnderALocaleWithDecimalCommas) {
  struct Commas : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
  };
  const Model expected = testing::two_link();
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Commas));
  const Model model = testing::two_link();
  std::string message;
  try {
    (void)with_payload(model, {.mass = -0.5});
  } catch (const std::invalid_argument& e) {
    message = e.what();
  }
  std::locale::global(before);
  EXPECT_EQ(model.bodies[0].mass, expected.bodies[0].mass);
  EXPECT_EQ(model.bodies[1].I_Bcm, expected.bodies[1].I_Bcm);
  EXPECT_THAT(message, HasSubstr("-0.5 kg"));
}

TEST(Urdf, TakesSixtyFourJointsAndAHundredAndTwentyEightBodies) {
  const Model model = model_from_urdf(testing::chain_urdf(64, 64), "chain");
  EXPECT_EQ(model.num_joints, 64);
  EXPECT_EQ(model.bodies.size(), 128u);
  EXPECT_EQ(model_from_urdf(testing::chain_urdf(1, 127), "chain").bodies.size(), 128u);
}

TEST(Urdf, AcceptsAMasslessLinkThatCarriesMass) {
  const std::string text =
      "<robot name='t'><link name='a'/><link name='cross'/><link name='b'><inertial><origin "
      "xyz='0.5 0 0'/><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' "
      "iyz='0'/></inertial></link><joint name='j1' type='continuous'><parent link='a'/><child "
      "link='cross'/><axis xyz='1 0 0'/></joint><joint name='j2' type='continuous'><parent "
      "link='cross'/><child link='b'/><axis xyz='0 1 0'/></joint></robot>";
  EXPECT_EQ(model_from_urdf(text, "t").num_joints, 2);
}

/// A two-joint arm without faults.
const char* const right_arm = R"(<?xml version="1.0"?>
<robot name="r">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.5" rpy="0 0 0"/>
      <mass value="2"/>
      <inertia ixx="0.2" iyy="0.2" izz="0.01" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="lower">
    <inertial>
      <origin xyz="0 0 0.4"/>
      <mass value="1"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.02" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="tool"/>
  <joint name="first" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <joint name="second" type="continuous">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0 0 1"/>
    <axis xyz="0 1 1"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="lower"/>
    <child link="tool"/>
  </joint>
</robot>
)";

struct Wrong {
  std::string name, from, to;
  std::vector<std::string> said;
};
void PrintTo(const Wrong& wrong, std::ostream* out) { *out << wrong.name; }

std::string made_wrong(const Wrong& wrong) {
  std::string text = right_arm;
  const std::size_t at = text.find(wrong.from);
  if (at == std::string::npos) throw std::runtime_error("nothing to change: " + wrong.from);
  return text.replace(at, wrong.from.size(), wrong.to);
}

const std::vector<Wrong>& wrong_arms() {
  static const std::vector<Wrong> arms{
      {"XmlCutShort", "</robot>", "", {"malformed XML"}},
      {"XmlTagMismatch", "</inertial>", "</inertia>", {"line ", "malformed XML"}},
      {"NotARobot",
       "<robot name=\"r\">",
       "<!-- --><machine></machine><robot name=\"r\"",
       {"malformed XML"}},
      {"LinkWithoutName", "<link name=\"tool\"/>", "<link/>", {"line 18", "a link has no name"}},
      {"JointWithoutName", "name=\"second\" ", "", {"a joint has no name"}},
      {"LinkTwice", "\"tool\"/>", "\"lower\"/>", {"link 'lower' is defined twice"}},
      {"JointTwice", "name=\"mount\"", "name=\"first\"", {"joint 'first' is defined twice"}},
      {"UnknownParent", "parent link=\"upper\"", "parent link=\"uper\"", {"second", "uper"}},
      {"UnknownChild", "child link=\"tool\"", "child link=\"tol\"", {"tol"}},
      {"NoParent", "<parent link=\"upper\"/>", "", {"second", "parent"}},
      {"NoChild", "<child link=\"tool\"/>", "", {"mount", "child"}},
      {"TwoRoots", "</robot>", "<link name=\"island\"/></robot>", {"island", "root"}},
      {"NoRoot",
       "</robot>",
       "<joint name=\"loop\" type=\"fixed\"><parent link=\"tool\"/><child "
       "link=\"base\"/></joint></robot>",
       {"on its own descendant"}},
      {"CycleBesideTheRoot",
       "parent link=\"base\"",
       "parent link=\"tool\"",
       {"hangs link 'lower' on its own descendant"}},
      {"JointOnItsOwnChild",
       "parent link=\"lower\"",
       "parent link=\"tool\"",
       {"joint 'mount' hangs link 'tool' on its own descendant"}},
      {"TwoParents",
       "</robot>",
       "<joint name=\"loop\" type=\"fixed\"><parent link=\"base\"/><child "
       "link=\"tool\"/></joint></robot>",
       {"link 'tool' is the child of two joints", "'loop'", "'mount'", "closed chains"}},
      {"DetachedCycle",
       "</robot>",
       "<link name=\"x\"/><link name=\"y\"/>"
       "<joint name=\"xy\" type=\"fixed\"><parent link=\"x\"/><child link=\"y\"/></joint>"
       "<joint name=\"yx\" type=\"fixed\"><parent link=\"y\"/><child link=\"x\"/></joint></robot>",
       {"joint 'yx' hangs link 'x' on its own descendant"}},
      {"Floating",
       "type=\"continuous\"",
       "type=\"floating\"",
       {"joint 'second'", "floating is not supported", "revolute"}},
      {"Planar",
       "type=\"continuous\"",
       "type=\"planar\"",
       {"joint 'second'", "planar is not supported"}},
      {"UnknownType",
       "type=\"continuous\"",
       "type=\"helical\"",
       {"joint 'second': type helical is not supported",
        "use revolute, continuous, prismatic or fixed", "robot.locked: {second: 0}"}},
      {"NoType", "type=\"continuous\"", "", {"joint 'second': has no type", "use revolute"}},
      {"Xacro",
       "<child link=\"tool\"/>",
       "<child link=\"tool\"/><xacro:origin/>",
       {"line 33", "\"<xacro:origin>\" is for xacro", "run xacro arm.urdf > robot.urdf and give"}},
      {"XacroElement", "</robot>", "<xacro:arm/></robot>", {"\"<xacro:arm>\" is for xacro"}},
      {"XacroNumber", "upper=\"2\"", "upper=\"${2*pi}\"", {"\"${2*pi}\" is for xacro"}},
      {"LimitsClosed",
       "lower=\"-2\" upper=\"2\"",
       "lower=\"0\" upper=\"0\"",
       {"joint 'first' (lower 0, upper 0): limits leave no room", "continuous", "fix it",
        "robot.locked: {first: 0}"}},
      {"LimitsReversed",
       "upper=\"2\"",
       "upper=\"-3\"",
       {"joint 'first' (lower -2, upper -3)", "lower < upper"}},
      {"NameThatEndsALine",
       "name=\"mount\"",
       "name=\"mo&#10;!touch PWNED\"",
       {"line 31", "joint 'mo !touch PWNED': not a name", "allowed: "}},
      {"NameThatIsACommand", "name=\"mount\"", "name=\"`reboot`\"", {"not a name"}},
      {"NameThatIsAFormula", "name=\"mount\"", "name=\"=1+1\"", {"not a name"}},
      {"LimitNotANumber", "effort=\"50\"", "effort=\"fifty\"", {"first", "effort"}},
      {"LimitInfinite", "effort=\"50\"", "effort=\"inf\"", {"first", "effort"}},
      {"ZeroAxis",
       "axis xyz=\"0 1 1\"",
       "axis xyz=\"0 0 0\"",
       {"joint 'second'", "axis 0 0 0", "no direction"}},
      {"AxisOfTwoNumbers", "axis xyz=\"0 1 1\"", "axis xyz=\"0 1\"", {"second", "xis"}},
      {"AxisNan", "axis xyz=\"0 1 1\"", "axis xyz=\"0 nan 1\"", {"second", "xis"}},
      {"OriginNan", "<origin xyz=\"0 0 1\"/>", "<origin xyz=\"0 0 nan\"/>", {"second", "origin"}},
      {"OriginOverflows",
       "<origin xyz=\"0 0 1\"/>",
       "<origin xyz=\"0 0 1e999\"/>",
       {"second", "origin"}},
      {"OriginFarAway",
       "<origin xyz=\"0 0 1\"/>",
       "<origin xyz=\"0 0 1e10\"/>",
       {"joint 'second': origin is 1e+10 m away", "up to 10000 m"}},
      {"DecimalComma",
       "<origin xyz=\"0 0 1\"/>",
       "<origin xyz=\"0 0 1,5\"/>",
       {"second", "origin"}},
      {"MimicUnknown",
       "<axis xyz=\"0 1 1\"/>",
       "<axis xyz=\"0 1 1\"/><mimic joint=\"third\"/>",
       {"joint 'second'", "mimics joint 'third'", "does not exist"}},
      {"MimicItself",
       "<axis xyz=\"0 1 1\"/>",
       "<axis xyz=\"0 1 1\"/><mimic joint=\"second\"/>",
       {"joint 'second'", "mimics itself"}},
      {"MimicMultiplierNan",
       "<axis xyz=\"0 1 1\"/>",
       "<axis xyz=\"0 1 1\"/><mimic joint=\"first\" multiplier=\"nan\"/>",
       {"second", "multiplier"}},
      {"NegativeMass",
       "<mass value=\"2\"/>",
       "<mass value=\"-2\"/>",
       {"link 'upper'", "mass -2 kg"}},
      {"MassNotANumber", "<mass value=\"2\"/>", "<mass value=\"two\"/>", {"upper", "mass"}},
      {"NoMass", "<mass value=\"2\"/>", "", {"upper", "mass"}},
      {"InertiaWithoutMass",
       "<mass value=\"2\"/>",
       "<mass value=\"0\"/>",
       {"link 'upper'", "inertia without mass"}},
      {"NegativeInertia", "iyy=\"0.2\"", "iyy=\"-0.2\"", {"link 'upper'", "principal moment -0.2"}},
      {"IndefiniteInertia", "ixy=\"0\"", "ixy=\"0.3\"", {"link 'upper'", "principal moment -0.1"}},
      {"TriangleInequality",
       "izz=\"0.01\"",
       "izz=\"0.41\"",
       {"link 'upper'", "triangle inequality", "0.41"}},
      {"InertiaIncomplete", " izz=\"0.01\"", "", {"upper", "inerti"}},
      {"InertiaNan", "izz=\"0.01\"", "izz=\"nan\"", {"upper", "inerti"}},
      {"NoInertiaToMove",
       "<mass value=\"1\"/>\n      <inertia ixx=\"0.1\" iyy=\"0.1\" izz=\"0.02\"",
       "<mass value=\"0\"/>\n      <inertia ixx=\"0\" iyy=\"0\" izz=\"0\"",
       {"joint 'second'", "moves no inertia", "mass"}},
  };
  return arms;
}

std::string complaint(const std::string& text) {
  try {
    (void)model_from_urdf(text, "arm.urdf");
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "accepted";
}

UrdfOptions options_with(const std::map<std::string, double>& locked,
                         CheckInertia check = CheckInertia::refuse) {
  UrdfOptions options;
  options.check_inertia = check;
  options.locked = locked;
  return options;
}

/// Returns the warnings from the loading of `text`.
std::vector<std::string> warnings(const std::string& text, const UrdfOptions& options = {}) {
  return model_from_urdf(text, "arm.urdf", options).warnings;
}

class WrongUrdf : public ::testing::TestWithParam<Wrong> {};
INSTANTIATE_TEST_SUITE_P(Arm, WrongUrdf, ::testing::ValuesIn(wrong_arms()),
                         [](const auto& arm) { return arm.param.name; });

TEST_P(WrongUrdf, IsRefusedOnOneLineThatNamesSourceAndCause) {
  ::testing::internal::CaptureStderr();
  ::testing::internal::CaptureStdout();
  const std::string said = complaint(made_wrong(GetParam()));
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_THAT(said, AllOf(StartsWith("arm.urdf: "), Not(HasSubstr("\n"))));
  for (const std::string& part : GetParam().said) EXPECT_THAT(said, HasSubstr(part));
  RecordProperty("message", said);
}

TEST(Urdf, AcceptsTheArmThatTheWrongOnesAreMadeFrom) {
  EXPECT_EQ(model_from_urdf(right_arm, "arm.urdf").num_joints, 2);
}

/// Returns arms whose faults do not affect the motion. Each gives a warning.
const std::vector<Wrong>& doubtful_arms() {
  static const std::vector<Wrong> arms{
      {"NoLimits",
       "<limit lower=\"-2\" upper=\"2\" effort=\"50\" velocity=\"3\"/>",
       "",
       {"joint first: no effort limit is given; none is assumed",
        "joint first: no range (lower, upper) is given; none is assumed",
        "joint first: no velocity limit is given; none is assumed"}},
      {"NoEffort", "effort=\"50\" ", "", {"joint first: no effort limit is given"}},
      {"NoVelocity", " velocity=\"3\"", "", {"joint first: no velocity limit is given"}},
      {"LimitsOfAnExporter",
       "<limit lower=\"-2\" upper=\"2\" effort=\"50\" velocity=\"3\"/>",
       "<limit lower=\"0\" upper=\"0\" effort=\"0\" velocity=\"0\"/>",
       {"joint first: no range (lower, upper)"}},
      {"NoRange", "lower=\"-2\" upper=\"2\" ", "", {"joint first: no range (lower, upper)"}},
      {"NegativeEffort", "effort=\"50\"", "effort=\"-1\"", {"effort limit -1 is taken for none"}},
      {"NegativeVelocity",
       "velocity=\"3\"",
       "velocity=\"-1\"",
       {"velocity limit -1 is taken for none"}},
      {"MimicFixed",
       "<axis xyz=\"0 1 1\"/>",
       "<axis xyz=\"0 1 1\"/><mimic joint=\"mount\" offset=\"0.5\"/>",
       {"joint 'second' mimics 'mount', which does not move; it is held at 0.5"}},
      {"FixedMimics",
       "<child link=\"tool\"/>",
       "<child link=\"tool\"/><mimic joint=\"first\"/>",
       {"joint 'mount' is fixed; that it mimics 'first' has no effect"}},
      {"ImpossibleToolMerged",
       "<link name=\"tool\"/>",
       "<link name=\"tool\"><inertial><mass value=\"0.1\"/><inertia ixx=\"1e-4\" iyy=\"1e-4\" "
       "izz=\"3e-4\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>",
       {"link 'tool': principal moments of inertia 0.0001, 0.0001, 0.0003"}},
      {"NegativeDamping",
       "<child link=\"lower\"/>",
       "<child link=\"lower\"/><dynamics damping=\"-1\" friction=\"0\"/>",
       {"joint 'second': damping -1 would drive the joint; it is not used"}},
  };
  return arms;
}

class DoubtfulUrdf : public ::testing::TestWithParam<Wrong> {};
INSTANTIATE_TEST_SUITE_P(Arm, DoubtfulUrdf, ::testing::ValuesIn(doubtful_arms()),
                         [](const auto& arm) { return arm.param.name; });

TEST_P(DoubtfulUrdf, IsReadWithAWarningThatNamesIt) {
  const std::vector<std::string> said = warnings(made_wrong(GetParam()));
  ASSERT_EQ(said.size(), GetParam().said.size()) << ::testing::PrintToString(said);
  for (std::size_t i = 0; i < said.size(); ++i) {
    EXPECT_THAT(said[i], AllOf(StartsWith("arm.urdf: "), HasSubstr(GetParam().said[i])));
  }
}

TEST(Urdf, WarnsOfNothingWhereNothingIsWrong) {
  EXPECT_THAT(warnings(right_arm), IsEmpty());
  std::string text = right_arm;
  text.replace(text.find(" name=\"r\""), 9, "");
  EXPECT_THAT(warnings(text), IsEmpty());
  // A thin rod, as printed by a program that rounds.
  text.replace(text.find("izz=\"0.01\""), 10, "izz=\"-5e-20\"");
  EXPECT_THAT(warnings(text), IsEmpty());
}

TEST(Urdf, DoesNotReadVisualsCollisionsAndWhatOthersAdd) {
  std::string text = right_arm;
  text.insert(
      text.find("</robot>"),
      "<material/><gazebo><x:y/></gazebo><transmission/><link name='flag'><visual><geometry>"
      "<box size='a b'/></geometry><material/></visual><collision/></link><joint name='pole' "
      "type='fixed'><parent link='tool'/><child link='flag'/><safety_controller/></joint>");
  EXPECT_EQ(model_from_urdf(text, "arm.urdf").num_joints, 2);
}

TEST(Urdf, ItsMechanicsReadAsTheSameModelAndAreTheirOwnMechanics) {
  const std::string text =
      testing::read_text(TACHLESS_SOURCE_DIR "/tests/core/robot/branching.urdf");
  const std::string mechanics = urdf_mechanics(text, "t");
  EXPECT_THAT(mechanics, AllOf(Not(HasSubstr("visual")), Not(HasSubstr("\n"))));
  EXPECT_EQ(urdf_mechanics(mechanics, "t"), mechanics);
  const Model whole = model_from_urdf(text, "t"), carried = model_from_urdf(mechanics, "t");
  EXPECT_EQ(carried.joint_names, whole.joint_names);
  EXPECT_EQ(carried.upper, whole.upper);
  ASSERT_EQ(carried.bodies.size(), whole.bodies.size());
  for (std::size_t i = 0; i < whole.bodies.size(); ++i) {
    EXPECT_EQ(carried.bodies[i].R_PB, whole.bodies[i].R_PB);
    EXPECT_EQ(carried.bodies[i].p_PB, whole.bodies[i].p_PB);
    EXPECT_EQ(carried.bodies[i].I_Bcm, whole.bodies[i].I_Bcm);
  }
}

TEST(Urdf, DoesNotJudgeWhatIsFixedToTheGround) {
  std::string text = right_arm;
  const std::string base = "<link name=\"base\"/>";
  text.replace(text.find(base), base.size(),
               "<link name='base'><inertial><mass value='-1'/><inertia ixx='-1' iyy='0' izz='9' "
               "ixy='0' ixz='0' iyz='0'/></inertial></link>");
  EXPECT_THAT(warnings(text), IsEmpty());
}

TEST(Urdf, NamesAllImpossibleInertiasAtOnceAndTheKeyThatAllowsThem) {
  std::string text = right_arm;
  text.replace(text.find("izz=\"0.01\""), 10, "izz=\"0.41\"");
  text.replace(text.find("izz=\"0.02\""), 10, "izz=\"0.31\"");
  EXPECT_THAT(complaint(text),
              AllOf(HasSubstr("link 'upper': principal"), HasSubstr("; link 'lower': principal"),
                    HasSubstr("robot.check_inertia: warn")));
  EXPECT_EQ(warnings(text, options_with({}, CheckInertia::warn)).size(), 2u);
}

TEST(Urdf, DoesNotOfferTheKeyWhereTheInertiaMatrixIsNotPositiveDefinite) {
  std::string text = right_arm;
  text.replace(text.find("iyy=\"0.1\""), 9, "iyy=\"-9\"");
  EXPECT_THAT(complaint(text), AllOf(HasSubstr("link 'lower'"), Not(HasSubstr("check_inertia")),
                                     HasSubstr("moves no inertia")));
  EXPECT_THROW((void)model_from_urdf(text, "t", options_with({}, CheckInertia::warn)),
               std::invalid_argument);
}

TEST(Urdf, CountsAnInertiaWithoutMassThatIsMerged) {
  std::string text = right_arm;
  const std::string tool = "<link name=\"tool\"/>";
  text.replace(text.find(tool), tool.size(),
               "<link name='tool'><inertial><mass value='0'/><inertia ixx='0.25' iyy='0.25' "
               "izz='0.25' ixy='0' ixz='0' iyz='0'/></inertial></link>");
  const Model model = model_from_urdf(text, "t");
  EXPECT_EQ(model.warnings.size(), 1u);
  EXPECT_EQ(model.bodies[1].mass, 1);
  EXPECT_EQ(model.bodies[1].I_Bcm(2, 2), 0.27);
}

TEST(Urdf, CountsRotorsBeforeItAsksForInertia) {
  std::string text = right_arm;
  for (const std::string from : {"<mass value=\"2\"/>", "<mass value=\"1\"/>"}) {
    const std::size_t at = text.find("<inertial>"), end = text.find("</inertial>") + 11;
    text.erase(at, end - at);
  }
  EXPECT_THAT(complaint(text), AllOf(HasSubstr("no link that moves has an <inertial>"),
                                     HasSubstr("rotor_inertia_kgm2")));
  Model model = read_urdf(text, "arm.urdf");
  model.rotor_inertia = Eigen::Vector2d(0.1, 0.1);
  EXPECT_NO_THROW(require_positive_inertia(model, "arm.urdf"));
}

TEST(Urdf, NamesAllJointsWithoutInertiaAtOnce) {
  std::string text = right_arm;
  for (const std::string link : {"f1", "f2"}) {
    text.insert(text.find("</robot>"),
                "<link name='" + link + "'/><joint name='to_" + link +
                    "' type='continuous'><parent link='tool'/><child link='" + link +
                    "'/></joint>");
  }
  EXPECT_THAT(complaint(text), AllOf(HasSubstr("joint 'to_f1', 'to_f2' moves no inertia"),
                                     HasSubstr("robot.locked: {to_f1: ..., to_f2: ...}")));
}

TEST(Urdf, LocksJointsWhereTheyAreToBe) {
  const Model locked = model_from_urdf(right_arm, "t", options_with({{"first", 0.5}}));
  EXPECT_THAT(locked.joint_names, ElementsAre("second"));
  // The same pose as the free arm's with its first joint there: rounding of one product.
  const Model free = model_from_urdf(right_arm, "t");
  const Eigen::Vector3d p = link_position(locked, "tool", Vector::Constant(1, 0.3));
  EXPECT_LT((p - link_position(free, "tool", Eigen::Vector2d(0.5, 0.3))).norm(), 4 * eps);
  const auto refused = [&](const std::map<std::string, double>& joints) {
    try {
      (void)model_from_urdf(right_arm, "t", options_with(joints));
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string("accepted");
  };
  EXPECT_THAT(refused({{"third", 0}}), HasSubstr("no joint 'third'; its joints are first, mount"));
  EXPECT_THAT(refused({{"first", 3}}),
              HasSubstr("3 of joint 'first' is outside its limits [-2, 2]"));
  EXPECT_THAT(refused({{"mount", 1}}), HasSubstr("joint 'mount' is fixed"));
}

TEST(Urdf, LocksAMimicWithTheJointThatDrivesIt) {
  const Model model =
      model_from_urdf(testing::read_text(TACHLESS_SOURCE_DIR "/tests/core/robot/branching.urdf"),
                      "t", options_with({{"lift", 0.2}}));
  EXPECT_THAT(model.joint_names, ElementsAre("turn", "wrist", "arm"));
  const Model free = testing::branching();
  const Vector q = Eigen::Vector3d(0.1, -0.4, 0.7), q_free = Eigen::Vector4d(0.1, 0.2, -0.4, 0.7);
  for (const char* link : {"hand", "finger", "claw"}) {
    // The rounding is that of a few rotations with entries up to 1.
    EXPECT_LT((link_position(model, link, q) - link_position(free, link, q_free)).norm(), 32 * eps)
        << link;
  }
}

TEST(Urdf, WeldsAJointOfAnUnsupportedTypeThatIsLocked) {
  std::string text = right_arm;
  text.replace(text.find("\"continuous\""), 12, "\"floating\"");
  EXPECT_EQ(model_from_urdf(text, "t", options_with({{"second", 0}})).num_joints, 1);
  EXPECT_THROW((void)model_from_urdf(text, "t", options_with({{"second", 1}})),
               std::invalid_argument);
}

TEST(Urdf, HangsTheRootLinkWhereItsBaseIs) {
  UrdfOptions ceiling;
  ceiling.base_rpy = {M_PI, 0, 0};
  ceiling.base_xyz = {0, 0, 3};
  const Model hanging = model_from_urdf(right_arm, "t", ceiling);
  const Model standing = model_from_urdf(right_arm, "t");
  const Vector q = Eigen::Vector2d(0.4, -0.2);
  // Gravity pulls the other way, seen from the root link; sin(pi) is 1e-16.
  EXPECT_LT((gravity_torque(hanging, q) + gravity_torque(standing, q)).norm(), 1e-13);
  EXPECT_LT((link_position(hanging, "tool", q) -
             (ceiling.base_xyz +
              Eigen::Vector3d(1, -1, -1).cwiseProduct(link_position(standing, "tool", q))))
                .norm(),
            1e-15);
}

TEST(Urdf, ReadsDampingAndFrictionAndAddsThoseOfMimicsToTheirJoint) {
  std::string text = testing::chain_urdf(2, 1);  // j3 turns half as fast as j1
  const std::string mimic = "<mimic";
  text.insert(text.find(mimic), "<dynamics damping='4' friction='2'/>");
  text.insert(text.find("</joint>"), "<dynamics damping='1' friction='3'/>");
  const Model model = model_from_urdf(text, "t");
  EXPECT_THAT(list(model.damping), ElementsAre(2, 0));
  EXPECT_THAT(list(model.friction), ElementsAre(4, 0));
}

TEST(Urdf, NarrowsTheLimitsOfAJointToThoseOfItsMimics) {
  // second = m first + offset; first has [-2, 2] rad and 3 rad/s.
  const auto arm = [](const std::string& limit, const std::string& mimic) {
    std::string text = right_arm;
    text.replace(text.find("\"continuous\">"), 13,
                 "\"revolute\"><limit " + limit + "/><mimic joint='first' " + mimic + "/>");
    return text;
  };
  const auto limits = [](const std::string& text) {
    const Model model = model_from_urdf(text, "arm.urdf");
    return std::vector<double>{model.lower[0], model.upper[0], model.velocity_limit[0]};
  };
  EXPECT_THAT(limits(arm("lower='-0.75' upper='1' effort='1' velocity='2'", "multiplier='4'")),
              ElementsAre(-0.1875, 0.25, 0.5));
  EXPECT_THAT(limits(arm("lower='-0.5' upper='1.5' effort='1' velocity='8'",
                         "multiplier='-2' offset='0.5'")),
              ElementsAre(-0.5, 0.5, 3));
  // The same limits but for rounding stay digit for digit.
  EXPECT_THAT(
      limits(arm("lower='-5.9999999' upper='6' effort='1' velocity='8.9999999'", "multiplier='3'")),
      ElementsAre(-2, 2, 3));
  // No limits of its own: zeros of an exporter, or none that it could be driven in.
  for (const char* none : {"", "lower='0' upper='0' effort='0' velocity='0'",
                           "lower='0' upper='0' effort='1' velocity='0'"}) {
    EXPECT_THAT(limits(arm(none, "multiplier='4'")), ElementsAre(-2, 2, 3)) << none;
  }
  const std::string apart = arm("lower='3' upper='4' effort='1' velocity='9'", "");
  EXPECT_THAT(limits(apart), ElementsAre(-2, 2, 3));
  EXPECT_THAT(warnings(apart), ElementsAre("arm.urdf: joint 'second': its limits leave joint "
                                           "'first' no room; they are not used"));
}

/// The element of franka_description. A limit decreases toward the end that the joint moves to.
TEST(Urdf, ReadsSpeedLimitsThatDecreaseTowardTheEndsOfTheRange) {
  const auto arm = [](const std::string& attributes) {
    std::string text = right_arm;
    text.insert(text.find("</joint>"), "<position_based_velocity_limits " + attributes + "/>");
    return text;
  };
  const Model model =
      model_from_urdf(arm("deceleration_limit='2' velocity_offset='0.5'"), "arm.urdf");
  EXPECT_THAT(list(model.deceleration_limit), ElementsAre(2, inf));
  EXPECT_THAT(list(model.velocity_offset), ElementsAre(0.5, 0));
  // first has [-2, 2] rad and 3 rad/s: sqrt(2 2 d) - 0.5 is 3 at d = 3.0625.
  EXPECT_EQ(speed_limit(model, 0, -1.5, 1), 3);
  EXPECT_EQ(speed_limit(model, 0, -1.5, -1), std::sqrt(2.0) - 0.5);
  EXPECT_EQ(speed_limit(model, 0, 1, 1), 1.5);
  EXPECT_EQ(speed_limit(model, 0, 1.99, 1), 0) << "v0 is above sqrt(2 a d)";
  EXPECT_EQ(speed_limit(model, 0, 2.1, 1), 0);
  EXPECT_EQ(speed_limit(model, 0, 2.1, 0), 3) << "a joint that rests";
  EXPECT_EQ(speed_limit(model, 1, 5, 1), inf) << "a continuous joint";
  EXPECT_EQ(speed_limit(model_from_urdf(right_arm, "arm.urdf"), 0, 2, 1), 3);
  EXPECT_THAT(complaint(arm("deceleration_limit='2'")), HasSubstr("has no velocity_offset"));
  EXPECT_THAT(complaint(arm("deceleration_limit='0' velocity_offset='0'")),
              HasSubstr("deceleration_limit=\"0\"; allowed: above 0"));
  EXPECT_THAT(complaint(arm("deceleration_limit='1' velocity_offset='-1'")),
              HasSubstr("velocity_offset=\"-1\"; allowed: 0 or more"));
  EXPECT_THAT(warnings(arm("deceleration_limit='1' velocity_offset='1' velocity_ofset='2'")),
              ElementsAre(HasSubstr("velocity_ofset")));
}

TEST(Urdf, NamesAllJointsWithoutRoomAtOnceWithTheLineThatLocksThem) {
  std::string text = right_arm;
  text.replace(text.find("upper=\"2\""), 9, "upper=\"-2\"");
  text.replace(text.find("\"continuous\">"), 13,
               "\"revolute\"><limit lower='1' upper='1' effort='1'/>");
  EXPECT_THAT(complaint(text), HasSubstr("joint 'first' (lower -2, upper -2), 'second' (lower 1, "
                                         "upper 1): limits leave no room"));
  EXPECT_THAT(complaint(text), HasSubstr("robot.locked: {first: -2, second: 1}"));
}

TEST(Urdf, TakesNumbersWithBlanksAroundThem) {
  std::string text = right_arm;
  text.replace(text.find("\"2\" effort"), 3, "\" 2.5 \"");
  text.replace(text.find("0 0 1\"/>"), 5, "  0\t0\n 1 ");
  const Model model = model_from_urdf(text, "t");
  EXPECT_EQ(model.upper[0], 2.5);
  EXPECT_EQ(body_of(model, "second").p_PB, Eigen::Vector3d(0, 0, 1));
}

/// A sign may lead a number. std::from_chars takes no '+', but takes inf and nan.
TEST(Urdf, TakesNumbersWithASignAndNoneThatIsNotFinite) {
  const auto with = [](const std::string& number) {
    std::string text = right_arm;
    return text.replace(text.find("\"2\" effort"), 3, "\"" + number + "\"");
  };
  EXPECT_EQ(model_from_urdf(with("+2.5e0"), "t").upper[0], 2.5);
  for (const char* wrong : {"+-2", "++2", "+", "", "inf", "nan", "1e999", "0x2", "2,5", "2 5"}) {
    EXPECT_THAT(complaint(with(wrong)), HasSubstr("allowed: a finite number")) << wrong;
  }
}

TEST(Urdf, WarnsOnceOfDefinitionsOfXacroThatNothingUses) {
  std::string text = right_arm;
  text.insert(text.find("<link name=\"base\""),
              "<xacro:property name='a' value='1'/><xacro:property name='b' value='${a}'/>"
              "<xacro:macro name='m'><link name='${x}'/></xacro:macro>");
  EXPECT_THAT(warnings(text), ElementsAre("arm.urdf: <xacro:macro>, <xacro:property> of xacro have "
                                          "no effect and are not read"));
}

TEST(Urdf, RefusesAMimicCycle) {
  std::string text = right_arm;
  const std::string limit = "velocity=\"3\"/>", axis = "<axis xyz=\"0 1 1\"/>";
  text.insert(text.find(limit) + limit.size(), "<mimic joint=\"second\"/>");
  text.insert(text.find(axis), "<mimic joint=\"first\"/>");
  EXPECT_THAT(complaint(text), HasSubstr("joint 'first': mimics itself by way of 'second'"));
}

TEST(Urdf, RefusesTextThatIsNoUrdf) {
  EXPECT_THAT(complaint(""), StartsWith("arm.urdf: "));
  EXPECT_THAT(complaint(""), HasSubstr("empty"));
  const std::string in_utf16("\xff\xfe<\0r\0>\0", 8);
  for (const std::string& other : {std::string("robot"), std::string("{\"robot\": 1}"),
                                   std::string("\x1f\x8b\x08"), in_utf16}) {
    EXPECT_THAT(complaint(other), HasSubstr("not XML text (UTF-8); give a robot's XML"));
  }
  EXPECT_THAT(complaint("<sdf/>"), HasSubstr("no <robot> element: it is an SDF file"));
  EXPECT_THAT(complaint("<mujoco/>"), HasSubstr("it is a model of MuJoCo"));
  EXPECT_THAT(complaint("<robot name='r'/>"), StartsWith("arm.urdf: "));
  EXPECT_THAT(complaint("<robot name='r'><link name='a'/></robot>"), HasSubstr("no joint moves"));
}

// Readers of XML recurse. Without a limit, 50,000 levels overflow the stack.
TEST(Urdf, RefusesWhatIsNestedTooDeeplyOrTooLarge) {
  const auto nested = [](int levels) {
    std::string text = "<!-- </robot> --><robot name='r'>";
    for (int i = 1; i < levels; ++i) text += "<a b='</a>'>";
    for (int i = 1; i < levels; ++i) text += "</a>";
    return text + "</robot>";
  };
  EXPECT_THAT(complaint(nested(50'000)), HasSubstr("line 1: elements nested too deep; allowed: "));
  EXPECT_THAT(complaint(nested(64)), HasSubstr("it has no link"));
  std::string wide = "<robot";
  for (int i = 0; i < 100'000; ++i) wide += " a" + std::to_string(i) + "=''";
  EXPECT_THAT(complaint(wide + "/>"), HasSubstr("an element has 100000 attributes"));
  EXPECT_THAT(complaint("<robot a='" + std::string(1'000'000, ' ') + "'/>"),
              HasSubstr("allowed: at most 1000000"));
}

TEST(Urdf, RefusesAnAttributeThatIsGivenTwice) {
  EXPECT_THAT(complaint("<robot name='r'>\n<link name='a' name='b'/></robot>"),
              HasSubstr("line 2: malformed XML: an attribute cannot be read, or is there twice"));
}

TEST(Urdf, RefusesMarkupThatIsNoElement) {
  EXPECT_THAT(complaint("<robot name='r'>\n<!ELEMENT a></robot>"),
              HasSubstr("line 2: malformed XML: <!ELEMENT a> is no element"));
  EXPECT_THAT(complaint("<robot name='r'>\n<?a b?></robot>"), HasSubstr("line 2: malformed XML"));
  EXPECT_THAT(complaint("<?xml version='1.0'?><!DOCTYPE robot><robot name='r'/>"),
              HasSubstr("it has no link"));
}

TEST(Urdf, RefusesMoreJointsAndBodiesThanThereIsRoomFor) {
  EXPECT_THAT(complaint(testing::chain_urdf(65)), HasSubstr("joint 'j65': more than 64 joints"));
  EXPECT_THAT(complaint(testing::chain_urdf(64, 65)),
              HasSubstr("joint 'j129': more than 128 moving bodies"));
}

/// Two joints about y; the texts that a case changes.
constexpr const char* duo = R"(<robot name="duo"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.2" rpy="0 0 0"/><mass value="2.5"/>
  <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.004"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.15" rpy="0 0 0"/><mass value="1.5"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/>
  <origin xyz="0 0 1" rpy="0 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="60" velocity="3"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0 -0.4" rpy="0 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
</robot>)";

std::string duo_with(const std::string& from, const std::string& to) {
  std::string text = duo;
  text.replace(text.find(from), from.size(), to);
  return text;
}

/// Returns the warnings of a URDF, or the reason for its refusal, on lines.
std::string said_of(const std::string& text) {
  try {
    return fmt::format("{}", fmt::join(model_from_urdf(text, "duo.urdf").warnings, "\n"));
  } catch (const std::invalid_argument& refused) {
    return std::string("refused: ") + refused.what();
  }
}

TEST(Urdf, SaysWhatItDoesNotReadOfAnElementThatItReads) {
  EXPECT_EQ(said_of(duo), "");
  const std::array<std::array<std::string, 3>, 12> cases{{
      {R"(<axis xyz="0 1 0"/>)", R"(<Axis xyz="0 1 0"/>)",
       "duo.urdf: j1: <Axis> in <joint> is not read; the nearest known name is axis"},
      {R"(<origin xyz="0 0 1")", R"(<origin pos="0 0 1")",
       "duo.urdf: j1: the attribute pos of <origin> is not read; known are xyz, rpy, quat_xyzw"},
      {R"(lower="-2" upper="2")", R"(min="-2" max="2")",
       "the attribute max of <limit> is not read"},
      {R"(<axis xyz="0 1 0"/>)", R"(<axis xyz="0 1 0"/><axis xyz="1 0 0"/>)",
       "refused: duo.urdf: line 7: joint 'j1': its <joint> has two <axis>; remove one"},
      {R"(<mass value="2.5"/>)", R"(<mass value="2.5"/><mass value="3"/>)",
       "link 'upper': its <inertial> has two <mass>"},
      {R"(<axis xyz="0 1 0"/>)", R"(<axis xyz="0 1 0">0 0 1</axis>)",
       "j1: the text in <axis> is not read; known are xyz"},
      {R"(<mass value="2.5"/>)", R"(<mass value="2.5" valeu="3"/>)",
       "the nearest known name is value"},
      {R"(<origin xyz="0 0 1" rpy="0 0 0"/>)", R"(<origin xyz="0 0 1" quat="0 0 0 1"/>)",
       "refused: duo.urdf: line 7: joint 'j1': its <origin> has quat; allowed: quat_xyzw"},
      {R"(<link name="base"/>)", R"(<link name="base"/><Link name="more"/>)",
       "more: <Link> in <robot> is not read; the nearest known name is link"},
      {R"(<link name="base"/>)", R"(<link name="base"/><include filename="x.urdf"/>)",
       "refused: duo.urdf: line 1: <include> is not followed"},
      {R"(<robot name="duo">)", R"(<!DOCTYPE robot [<!ENTITY h "0.4">]><robot name="duo">)",
       "refused: duo.urdf: line 1: <!DOCTYPE … [: an internal DTD is not read"},
      {R"(</robot>)",
       R"(<transmission><joint name="j1"/><actuator name="m"><drake:rotor_inertia value="0.0001"/>
          <drake:gear_ratio value="100"/></actuator></transmission></robot>)",
       "j1: <drake:rotor_inertia> is not read; it is 0.0001 * 100^2 = 1 kg m2 at the joint"},
  }};
  for (const auto& [from, to, expected] : cases) {
    EXPECT_THAT(said_of(duo_with(from, to)), HasSubstr(expected)) << to;
  }
}

TEST(Urdf, ReadsQuaternions) {
  const std::string turned =
      duo_with(R"(xyz="0 0 -0.4" rpy="0 0 0")", R"(xyz="0 0 -0.4" rpy="0.7 0 0")");
  const std::string quaternion =
      duo_with(R"(xyz="0 0 -0.4" rpy="0 0 0")",
               R"(xyz="0 0 -0.4" quat_xyzw="0.34289780745545134 0 0 0.9393727128473789")");
  EXPECT_TRUE(model_from_urdf(quaternion, "q")
                  .bodies[1]
                  .R_PB.isApprox(model_from_urdf(turned, "r").bodies[1].R_PB, 1e-14));
  const Model again = model_from_urdf(urdf_mechanics(quaternion, "q"), "again");
  EXPECT_EQ(again.bodies[1].R_PB, model_from_urdf(quaternion, "q").bodies[1].R_PB);
  for (const char* wrong : {"0 0 0", "0 0 0 2", "0 0 0 x", "0 0 0 1\" rpy=\"0 0 0"}) {
    EXPECT_THAT(
        said_of(duo_with(R"(rpy="0 0 0"/><axis)", fmt::format("quat_xyzw=\"{}\"/><axis", wrong))),
        StartsWith("refused: "))
        << wrong;
  }
}

TEST(Urdf, TakesAWorldThatIsNoLinkForTheGround) {
  const std::string text = duo_with(
      "</robot>",
      R"(<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint></robot>)");
  EXPECT_THAT(said_of(text), HasSubstr("its parent link 'world' is not in the file; it is "
                                       "taken for the ground"));
  EXPECT_EQ(model_from_urdf(text, "w").num_joints, 2);
}

TEST(Urdf, NamesNumbersThatAreImprobable) {
  const auto lines = [](const std::string& text) {
    return fmt::format("{}", fmt::join(improbable_numbers(text, "duo.urdf", {}), "\n"));
  };
  EXPECT_EQ(lines(duo), "");
  const std::array<std::array<std::string, 3>, 9> cases{{
      {R"(effort="60")", R"(effort="0")",
       "duo.urdf: joint 'j1': effort 0: it is driven without limit"},
      {R"(velocity="3")", R"(velocity="0")", "joint 'j1': velocity 0"},
      {R"(lower="-2" upper="2")", R"(lower="-120" upper="120")",
       "joint 'j1': its range is -120 to 120 rad; is it in degrees?"},
      {R"(xyz="0 0 -0.4" rpy="0 0 0")", R"(xyz="0 0 -0.4" rpy="0 90 0")",
       "joint 'j2': its origin has an angle of 90 rad; is it in degrees?"},
      {R"(xyz="0 0 -0.4")", R"(xyz="0 0 -400")", "joint 'j2': its origin is 400 m away"},
      {R"(xyz="0 0 -0.15")", R"(xyz="0 0 -150")", "link 'lower': its centre of mass is 150 m away"},
      {R"(mass value="1.5")", R"(mass value="1500")",
       "link 'lower': it has 1500 kg; is it in grams?"},
      {R"(ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002")",
       R"(ixx="1.5" ixy="0" ixz="0" iyy="1.5" iyz="0" izz="1.5")",
       "link 'lower': its radius of gyration is 1 m; the link is 0.4 m long"},
      {R"(ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002")",
       R"(ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0")",
       "link 'lower': 1.5 kg without inertia"},
  }};
  for (const auto& [from, to, expected] : cases) {
    EXPECT_THAT(lines(duo_with(from, to)), HasSubstr(expected)) << to;
  }
}

}  // namespace
}  // namespace tachless::robot
