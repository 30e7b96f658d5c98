#include "scenario/scenario.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

#include "robot/kinematics.h"
#include "tests/support/temporary_directory.h"

namespace tachless::scenario {
namespace {

using controller::law::Discretisation;
using controller::law::FilterStart;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
namespace trajectory = reference::trajectory;

// Two links; the second joint alone has limits and an effort limit.
constexpr const char* urdf = R"(<robot name="two">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="1 0 0"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2.5" effort="30" velocity="4"/></joint>
</robot>
)";

constexpr const char* minimal = R"(name: test
robot:
  urdf: two.urdf
reference:
  hold: {position_rad: [0.1, 0.2]}
controller:
  law: loria_ortega_rigid
  gains: {kp: [1, 2], kd: 3}
)";

// Every line is the target of a mutation below.
constexpr const char* full = R"(name: test
robot:
  name: arm
  urdf: two.urdf
  gravity_m_per_s2: 9.8
  joints: rigid
plant:
  initial:
    position_rad: [0.5, -0.5]
    velocity_rad_per_s: 0
  integrator:
    # relative, of one step
    accuracy: 1.0e-7
  encoder:
    resolution_bits: 16
    noise_std_rad: 1.0e-5
    velocity_noise_std_rad_per_s: 1.0e-3
    seed: 7
    side: link
  drive:
    torque_limit_Nm: [100, 50]
    viscous_friction_Nms_per_rad: [0.1, 0]
  payload:
    mass_kg: 0.5
    link: lower
reference:
  sinusoid:
    amplitude_rad: [0.1, 0.2]
    frequency_hz: 5
    phase_rad: [0, 1]
    offset_rad: 0
controller:
  law: loria_ortega_rigid
  gains:
    kp: [40, 20]
    kd: [4, 2]
  filter: tustin
  filter_start: zero
  feedforward_lead: half_tick_plus_delay
loop:
  mode: realtime
  period_s: 1.0e-3
  duration_s: 2.5
  command_delay: 0
  max_missed: 5
  give_up_s: 2
)";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::logic_error("the test's text has no " + from);
  return text.replace(at, from.size(), to);
}

std::string refusal(const std::function<void()>& attempt) {
  try {
    attempt();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), Not(HasSubstr("\n")));
    return failure.what();
  }
  return "accepted";
}

std::string refusal_of(const std::string& text, const std::vector<std::string>& overrides = {}) {
  return refusal([&] { parse_scenario(text, urdf, "f.yaml", overrides); });
}

Scenario parsed(const std::string& text, const std::vector<std::string>& overrides = {}) {
  return parse_scenario(text, urdf, "f.yaml", overrides);
}

std::vector<double> values(const Vector& vector) {
  return {vector.data(), vector.data() + vector.size()};
}

void expect_same(const Scenario& a, const Scenario& b) {
  EXPECT_EQ(a.text, b.text);
  EXPECT_EQ(a.digest, b.digest);
  EXPECT_EQ(a.name, b.name);
  EXPECT_EQ(a.robot.urdf_text, b.robot.urdf_text);
  EXPECT_EQ(a.robot.gravity_m_per_s2, b.robot.gravity_m_per_s2);
  EXPECT_EQ(a.plant.initial.position_rad, b.plant.initial.position_rad);
  EXPECT_EQ(a.plant.integrator.accuracy, b.plant.integrator.accuracy);
  EXPECT_EQ(a.plant.encoder.resolution_bits, b.plant.encoder.resolution_bits);
  EXPECT_EQ(a.plant.drive.torque_limit_Nm.has_value(), b.plant.drive.torque_limit_Nm.has_value());
  EXPECT_EQ(a.plant.payload.link, b.plant.payload.link);
  EXPECT_EQ(a.reference.index(), b.reference.index());
  EXPECT_EQ(a.controller.law, b.controller.law);
  EXPECT_EQ(a.controller.gains, b.controller.gains);
  EXPECT_EQ(a.controller.filter, b.controller.filter);
  EXPECT_EQ(a.loop.period_s, b.loop.period_s);
  EXPECT_EQ(a.loop.num_ticks, b.loop.num_ticks);
  EXPECT_EQ(a.loop.command_delay, b.loop.command_delay);
}

TEST(Scenario, ReadsEveryKey) {
  const Scenario s = parsed(full);
  EXPECT_EQ(s.name, "test");
  EXPECT_EQ(s.num_joints, 2);
  EXPECT_EQ(s.robot.name, "arm");
  EXPECT_EQ(s.robot.channel_prefix, "ARM");
  EXPECT_EQ(s.robot.urdf_path, "two.urdf");
  EXPECT_EQ(s.robot.urdf_text, robot::urdf_mechanics(urdf, ""));
  EXPECT_EQ(s.robot.check_inertia, robot::CheckInertia::refuse);
  EXPECT_THAT(s.robot.locked, ::testing::IsEmpty());
  EXPECT_THAT(s.robot.base.rpy, ElementsAre(0, 0, 0));
  EXPECT_EQ(s.robot.gravity_m_per_s2, 9.8);
  EXPECT_FALSE(s.robot.flexible);
  EXPECT_THAT(values(s.plant.initial.position_rad), ElementsAre(0.5, -0.5));
  EXPECT_THAT(values(s.plant.initial.velocity_rad_per_s), ElementsAre(0, 0));
  EXPECT_EQ(s.plant.integrator.accuracy, 1e-7);
  EXPECT_THAT(values(s.plant.encoder.resolution_bits.value()), ElementsAre(16, 16));
  EXPECT_EQ(s.plant.encoder.noise_std_rad, 1e-5);
  EXPECT_EQ(s.plant.encoder.velocity_noise_std_rad_per_s, 1e-3);
  EXPECT_EQ(s.plant.encoder.seed, 7U);
  EXPECT_EQ(s.plant.encoder.side, plant::EncoderSide::link);
  EXPECT_THAT(values(s.plant.drive.torque_limit_Nm.value()), ElementsAre(100, 50));
  EXPECT_THAT(values(s.plant.drive.viscous_friction_Nms_per_rad), ElementsAre(0.1, 0));
  EXPECT_EQ(s.plant.payload.mass_kg, 0.5);
  EXPECT_EQ(s.plant.payload.link, "lower");
  const auto& sinusoid = std::get<trajectory::Sinusoid>(s.reference);
  EXPECT_THAT(values(sinusoid.amplitude_rad), ElementsAre(0.1, 0.2));
  EXPECT_THAT(values(sinusoid.frequency_hz), ElementsAre(5, 5));
  EXPECT_THAT(values(sinusoid.phase_rad), ElementsAre(0, 1));
  EXPECT_THAT(values(sinusoid.offset_rad), ElementsAre(0, 0));
  EXPECT_EQ(s.controller.law, "loria_ortega_rigid");
  EXPECT_THAT(values(s.controller.gains.at("kp")), ElementsAre(40, 20));
  EXPECT_THAT(values(s.controller.gains.at("kd")), ElementsAre(4, 2));
  EXPECT_EQ(s.controller.filter, Discretisation::tustin);
  EXPECT_EQ(s.controller.filter_start, FilterStart::zero);
  EXPECT_EQ(s.controller.feedforward_lead, controller::FeedforwardLead::half_tick_plus_delay);
  EXPECT_EQ(s.loop.mode, Mode::realtime);
  EXPECT_EQ(s.loop.period_s, 1e-3);
  EXPECT_EQ(s.loop.duration_s, 2.5);
  EXPECT_EQ(s.loop.num_ticks, 2500);
  EXPECT_EQ(s.loop.command_delay, 0);
  EXPECT_EQ(s.loop.max_missed, 5);
  EXPECT_EQ(s.loop.give_up_s, 2);
}

/// Expects the struct's default for every key that has it, also in nested structs.
template <class Struct>
void expect_defaults(const Struct& read) {
  const Struct fresh;
  base::for_each_key<Struct>([&](const auto& key) {
    if constexpr (std::is_member_object_pointer_v<decltype(key.member)>) {
      using Member = std::remove_cvref_t<decltype(read.*key.member)>;
      if constexpr (base::has_keys<Member>) {
        expect_defaults(read.*key.member);
      } else if constexpr (base::shape_of<Member> <= base::Shape::whole) {
        if (key.fallback == base::Default::of_struct) {
          EXPECT_EQ(read.*key.member, fresh.*key.member) << key.name;
        }
      }
    }
  });
}

TEST(Scenario, FillsInTheDocumentedDefaultsWhichAreThoseOfTheStruct) {
  const Scenario s = parsed(minimal);
  expect_defaults(s.robot);
  expect_defaults(s.plant);
  expect_defaults(s.controller);
  expect_defaults(s.loop);
  EXPECT_EQ(s.robot.channel_prefix, "ARM");
  EXPECT_FALSE(s.robot.flexible);
  EXPECT_FALSE(s.plant.initial.motor_position_rad);
  EXPECT_FALSE(s.plant.encoder.resolution_bits);
  for (const Vector* zero :
       {&s.robot.rigid_rotor_inertia_kgm2, &s.plant.initial.position_rad,
        &s.plant.initial.velocity_rad_per_s, &s.plant.drive.viscous_friction_Nms_per_rad}) {
    EXPECT_THAT(values(*zero), ElementsAre(0, 0));
  }
  EXPECT_EQ(s.plant.on_limit, plant::OnLimit::stop);
  EXPECT_EQ(s.loop.max_missed_share, 0.01);
}

TEST(Scenario, TakesOneNumberForEveryJoint) {
  EXPECT_THAT(values(parsed(minimal).controller.gains.at("kd")), ElementsAre(3, 3));
}

TEST(Scenario, TorqueLimitIsTheUrdfsUnlessNullOrGiven) {
  const double unlimited = std::numeric_limits<double>::infinity();
  EXPECT_THAT(values(parsed(minimal).plant.drive.torque_limit_Nm.value()),
              ElementsAre(unlimited, 30));
  EXPECT_FALSE(parsed(minimal, {"plant.drive.torque_limit_Nm=null"}).plant.drive.torque_limit_Nm);
  EXPECT_THAT(
      values(
          parsed(minimal, {"plant.drive.torque_limit_Nm=7"}).plant.drive.torque_limit_Nm.value()),
      ElementsAre(7, 7));
}

TEST(Scenario, AsksAboutDegreesWhereARangeIsLeftByMoreThanATurn) {
  EXPECT_THAT(refusal_of(minimal, {"plant.initial.position_rad=[0, 90]"}),
              AllOf(HasSubstr("90 of joint elbow"), HasSubstr("were degrees given?")));
  EXPECT_THAT(refusal_of(minimal, {"plant.initial.position_rad=[0, 3]"}),
              AllOf(HasSubstr("3 of joint elbow"), Not(HasSubstr("degrees"))));
}

TEST(Scenario, ReadsWhatALimitDoes) {
  EXPECT_EQ(parsed(minimal, {"plant.on_limit=warn"}).plant.on_limit, plant::OnLimit::warn);
  EXPECT_THAT(refusal_of(minimal, {"plant.on_limit=ignore"}),
              AllOf(HasSubstr("plant.on_limit: ignore"), HasSubstr("stop, warn")));
}

TEST(Scenario, ReadsFlexibleJoints) {
  const Scenario s = parsed(
      minimal, {"robot.joints={flexible: {stiffness_Nm_per_rad: [1e4, 2e4], rotor_inertia_kgm2: "
                "0.1}}",
                "plant.initial.motor_position_rad=[1, 2]",
                "plant.initial.motor_velocity_rad_per_s=3", "plant.encoder.side=motor"});
  ASSERT_TRUE(s.robot.flexible);
  EXPECT_THAT(values(s.robot.flexible->stiffness), ElementsAre(1e4, 2e4));
  EXPECT_THAT(values(s.robot.flexible->rotor_inertia), ElementsAre(0.1, 0.1));
  EXPECT_THAT(values(s.robot.flexible->motor_damping), ElementsAre(0, 0));
  EXPECT_THAT(values(s.robot.flexible->spring_damping), ElementsAre(0, 0));
  EXPECT_THAT(values(s.plant.initial.motor_position_rad.value()), ElementsAre(1, 2));
  EXPECT_THAT(values(s.plant.initial.motor_velocity_rad_per_s.value()), ElementsAre(3, 3));
  EXPECT_EQ(s.plant.encoder.side, plant::EncoderSide::motor);
}

TEST(Scenario, ReadsRigidJointsWithRotors) {
  EXPECT_THAT(values(parsed(minimal, {"robot.joints={rigid: {rotor_inertia_kgm2: [0.1, 0]}}"})
                         .robot.rigid_rotor_inertia_kgm2),
              ElementsAre(0.1, 0));
  EXPECT_THAT(values(parsed(minimal, {"robot.joints={rigid: {}}"}).robot.rigid_rotor_inertia_kgm2),
              ElementsAre(0, 0));
}

TEST(Scenario, ReadsEveryKindOfReference) {
  EXPECT_THAT(values(std::get<trajectory::Hold>(parsed(minimal).reference).position_rad),
              ElementsAre(0.1, 0.2));
  const auto multi_sine = std::get<trajectory::MultiSine>(
      parsed(minimal, {"reference={multi_sine: {offset_rad: 1, terms: [{amplitude_rad: 2, "
                       "frequency_hz: [3, 4]}, {amplitude_rad: 5, frequency_hz: 6, phase_rad: "
                       "7}]}}"})
          .reference);
  EXPECT_THAT(values(multi_sine.offset_rad), ElementsAre(1, 1));
  ASSERT_EQ(multi_sine.terms.size(), 2U);
  EXPECT_THAT(values(multi_sine.terms[0].frequency_hz), ElementsAre(3, 4));
  EXPECT_THAT(values(multi_sine.terms[0].phase_rad), ElementsAre(0, 0));
  EXPECT_THAT(values(multi_sine.terms[1].phase_rad), ElementsAre(7, 7));
  const auto motion = std::get<trajectory::PointToPoint>(
      parsed(minimal, {"reference={point_to_point: {from_rad: 0, to_rad: [1, 2], start_s: 0.5}}"})
          .reference);
  EXPECT_THAT(values(motion.to_rad), ElementsAre(1, 2));
  EXPECT_EQ(motion.start_s, 0.5);
  EXPECT_EQ(motion.duration_s, 1);
  const auto waypoints = std::get<trajectory::Waypoints>(
      parsed(minimal,
             {"reference={waypoints: {time_s: [0, 1, 2.5], position_rad: [0, [1, 2], [3, 4]]}}"})
          .reference);
  EXPECT_THAT(waypoints.time_s, ElementsAre(0, 1, 2.5));
  EXPECT_THAT(values(waypoints.position_rad[0]), ElementsAre(0, 0));
  EXPECT_THAT(values(waypoints.position_rad[2]), ElementsAre(3, 4));
}

TEST(Scenario, NamesEveryChoiceOfEveryEnum) {
  const auto mechanics = [](const std::string& name) {
    return parsed(minimal, {"plant.mechanics=" + name}).plant.mechanics;
  };
  EXPECT_EQ(mechanics("simbody"), plant::Mechanics::simbody);
  EXPECT_EQ(mechanics("native"), plant::Mechanics::native);
  const auto filter = [](const std::string& name) {
    return parsed(minimal, {"controller.filter=" + name}).controller.filter;
  };
  EXPECT_EQ(filter("first_order_hold"), Discretisation::first_order_hold);
  EXPECT_EQ(filter("tustin"), Discretisation::tustin);
  EXPECT_EQ(filter("backward_euler"), Discretisation::backward_euler);
  EXPECT_EQ(filter("zero_order_hold"), Discretisation::zero_order_hold);
  EXPECT_EQ(parsed(minimal, {"controller.filter_start=at_error"}).controller.filter_start,
            FilterStart::at_error);
  EXPECT_EQ(parsed(minimal, {"controller.feedforward_lead=none"}).controller.feedforward_lead,
            controller::FeedforwardLead::none);
  EXPECT_EQ(parsed(minimal, {"plant.encoder.side=link"}).plant.encoder.side,
            plant::EncoderSide::link);
}

TEST(Scenario, AnAnchorIsWrittenOutInTheText) {
  const Scenario s =
      parsed(replaced(replaced(full, "amplitude_rad: [0.1, 0.2]", "amplitude_rad: &a [0.1, 0.2]"),
                      "[40, 20]", "*a"));
  EXPECT_THAT(values(s.controller.gains.at("kp")), ElementsAre(0.1, 0.2));
  EXPECT_THAT(s.text, Not(HasSubstr("*a")));
}

TEST(Scenario, AGainMayBeAMatrixWithAListPerJoint) {
  const Scenario s = parsed(replaced(full, "[40, 20]", "[[40, 3], [3, 20]]"));
  EXPECT_THAT(values(s.controller.gains.at("kp")), ElementsAre(40, 3, 3, 20));
}

// ---- what is refused -------------------------------------------------------------------------

struct Mutation {
  const char* from;  ///< in `full`
  const char* to;
  std::vector<const char*> fragments;  ///< of the message
};

TEST(Scenario, EveryMalformedOneIsRefusedWithFileLineKeyValueAndRange) {
  const std::vector<Mutation> mutations = {
      // Unknown keys
      {"period_s:",
       "perod_s:",
       {"f.yaml:42: loop.perod_s: unknown", "nearest known key is loop.period_s"}},
      {"sinusoid:", "sinusiod:", {"f.yaml:27: reference.sinusiod: unknown", "reference.sinusoid"}},
      {"name: test",
       "name: test\nperiod_s: 1",
       {"f.yaml:2: period_s: unknown; known here: loop.period_s"}},
      {"name: test",
       "name: test\nquux: 1",
       {"f.yaml:2: quux: unknown; known keys of a scenario: "}},
      {"joints: rigid",
       "joints: rigid\n  mass_kg: 1",
       {"f.yaml:7: robot.mass_kg: unknown; known here: plant.payload.mass_kg"}},
      {"  joints: rigid",
       "  joints: {rigid: {rotor_inertia: 1}}",
       {"f.yaml:6: robot.joints.rigid.rotor_inertia: unknown",
        "robot.joints.rigid.rotor_inertia_kgm2"}},
      // Missing keys
      {"name: test\n", "", {"f.yaml", "name: missing"}},
      {"  urdf: two.urdf\n", "", {"f.yaml:2: robot.urdf: missing"}},
      {"    amplitude_rad: [0.1, 0.2]\n",
       "",
       {"f.yaml:27: reference.sinusoid.amplitude_rad: missing", "one per joint"}},
      {"  law: loria_ortega_rigid\n", "", {"f.yaml:32: controller.law: missing"}},
      {"  gains:\n    kp: [40, 20]\n    kd: [4, 2]\n",
       "",
       {"f.yaml:32: controller.gains: missing", "a map"}},
      {"  joints: rigid",
       "  joints: {flexible: {rotor_inertia_kgm2: 1}}",
       {"f.yaml:6: robot.joints.flexible.stiffness_Nm_per_rad: missing", "> 0"}},
      // Given twice
      {"  seed",
       "  noise_std_rad: 1\n    seed",
       {"f.yaml:18: plant.encoder.noise_std_rad: given twice", "line 16"}},
      {"loop:", "loop: {}\nloop:", {"f.yaml:41: loop: given twice", "line 40"}},
      // Types
      {"  sinusoid:", "  sinusoid: 5\n  #", {"f.yaml", "not YAML"}},
      {"period_s: 1.0e-3",
       "period_s: fast",
       {"f.yaml:42: loop.period_s: fast", "a finite number in (0, 1]"}},
      {"period_s: 1.0e-3",
       "period_s: \"0.001\"",
       {"f.yaml:42: loop.period_s: \"0.001\"", "a finite number"}},
      {"period_s: 1.0e-3", "period_s: null", {"f.yaml:42: loop.period_s: null"}},
      {"period_s: 1.0e-3", "period_s:", {"f.yaml:42: loop.period_s: null"}},
      {"name: test", "name: [a]", {"f.yaml:1: name: [a]", "allowed: text"}},
      {"max_missed: 5", "max_missed: 5.5", {"f.yaml:45: loop.max_missed: 5.5", "a whole number"}},
      {"kp: [40, 20]", "kp: {a: 1}", {"f.yaml:35: controller.gains.kp: {a: 1}", "one per joint"}},
      {"  joints: rigid",
       "  joints: flexible",
       {"f.yaml:6: robot.joints: flexible", "exactly one of rigid, flexible"}},
      {"  joints: rigid",
       "  joints: {}",
       {"f.yaml:6: robot.joints: no kind", "exactly one of rigid, flexible"}},
      {"  joints: rigid",
       "  joints: {rigid: {}, flexible: {stiffness_Nm_per_rad: 1, rotor_inertia_kgm2: 1}}",
       {"f.yaml:6: robot.joints: both rigid and flexible"}},
      {"# relative, of one step", "method: euler", {"f.yaml:12: plant.integrator.method"}},
      {"mode: realtime", "mode: real", {"f.yaml:41: loop.mode: real", "one of lockstep, realtime"}},
      // Lengths
      {"kp: [40, 20]",
       "kp: [40, 20, 10]",
       {"f.yaml:35: controller.gains.kp: [40, 20, 10] has length 3", "2 joints"}},
      {"kp: [40, 20]",
       "kp: [[40, 20]]",
       {"f.yaml:35: controller.gains.kp: [[40, 20]] is a matrix of 1 rows", "2 joints"}},
      // Ranges
      {"period_s: 1.0e-3", "period_s: 0", {"f.yaml:42: loop.period_s: 0", "in (0, 1]"}},
      {"period_s: 1.0e-3", "period_s: .nan", {"loop.period_s: .nan", "finite"}},
      {"duration_s: 2.5", "duration_s: .inf", {"f.yaml:43: loop.duration_s: .inf", "finite"}},
      {"duration_s: 2.5",
       "duration_s: 2.5004",
       {"f.yaml:43: loop.duration_s: 2.5004", "nearest is 2.5"}},
      {"duration_s: 2.5", "duration_s: 1e-6", {"loop.duration_s: ", "nearest is 0.001"}},
      {"duration_s: 2.5",
       "duration_s: 2e6",
       {"f.yaml:43: loop.duration_s: 2e+09 ticks", "at most 1e+09 ticks"}},
      {"kp: [40, 20]",
       "kp: [40, .nan]",
       {"f.yaml:35: controller.gains.kp: entry 2 of [40, .nan] is .nan", "finite"}},
      {"command_delay: 0",
       "command_delay: 17",
       {"f.yaml:44: loop.command_delay: 17", "in [0, 16]"}},
      {"accuracy: 1.0e-7",
       "accuracy: 1e-15",
       {"f.yaml:13: plant.integrator.accuracy: 1e-15", "in [1e-14, 0.1]"}},
      {"resolution_bits: 16",
       "resolution_bits: 0",
       {"f.yaml:15: plant.encoder.resolution_bits: 0", "in [1, 52]; or null"}},
      {"resolution_bits: 16",
       "resolution_bits: [16, 20.5]",
       {"plant.encoder.resolution_bits: entry 2 of [16, 20.5] is 20.5", "whole and in [1, 52]"}},
      {"noise_std_rad: 1.0e-5",
       "noise_std_rad: -1.0e-5",
       {"f.yaml:16: plant.encoder.noise_std_rad: -1.0e-5", ">= 0"}},
      {"seed: 7", "seed: -7", {"f.yaml:18: plant.encoder.seed: -7", "a whole number in [0, "}},
      {"torque_limit_Nm: [100, 50]",
       "torque_limit_Nm: [100, 0]",
       {"f.yaml:21: plant.drive.torque_limit_Nm: entry 2 of [100, 0] is 0", "> 0; or null"}},
      {"link: lower",
       "link: hand",
       {"f.yaml:25: plant.payload.link: \"hand\"", "allowed: base, lower, upper"}},
      {"link: lower", "link: base", {"f.yaml:25: plant.payload.link: ", "ground"}},
      {"position_rad: [0.5, -0.5]",
       "position_rad: [0.5, -2.5]",
       {"f.yaml:9: plant.initial.position_rad: -2.5 of joint elbow", "in [-2, 2.5]"}},
      {"  joints: rigid",
       "  joints: {flexible: {stiffness_Nm_per_rad: [1, 0], rotor_inertia_kgm2: 1}}",
       {"f.yaml:6: robot.joints.flexible.stiffness_Nm_per_rad: entry 2 of [1, 0] is 0", "> 0"}},
      // Names
      {"name: test", "name: a/b", {"f.yaml:1: name: \"a/b\"", "letters"}},
      {"name: test", "name: \"\"", {"f.yaml:1: name: \"\""}},
      {"name: arm", "name: my-arm", {"f.yaml:3: robot.name: \"my-arm\"", "letters, digits and _"}},
      {"law: loria_ortega_rigid",
       "law: Loria Ortega",
       {"f.yaml:33: controller.law: \"Loria Ortega\"", "lower-case"}},
      {"kp: [40, 20]", "k p: [40, 20]", {"f.yaml:35: controller.gains.k p: not a gain's name"}},
      // Keys that contradict each other
      {"position_rad: [0.5, -0.5]",
       "position_rad: 0\n    motor_position_rad: 0",
       {"f.yaml:10: plant.initial.motor_position_rad: ", "rigid joints", "flexible"}},
      {"side: link", "side: motor", {"f.yaml:19: plant.encoder.side: motor", "rigid joints"}},
      {"  sinusoid:",
       "  hold: {position_rad: 0}\n  sinusoid:",
       {"f.yaml:26: reference: both hold and sinusoid"}},
      {"  sinusoid:\n    amplitude_rad: [0.1, 0.2]\n    frequency_hz: 5\n    phase_rad: [0, 1]\n   "
       " offset_rad: 0\n",
       "  {}\n",
       {"f.yaml:26: reference: no kind",
        "exactly one of hold, sinusoid, multi_sine, point_to_point, waypoints, file"}},
      {"reference:\n  sinusoid:\n    amplitude_rad: [0.1, 0.2]\n    frequency_hz: 5\n    "
       "phase_rad: [0, 1]\n    offset_rad: 0\n",
       "",
       {"f.yaml: reference: no kind"}},
      // Not a scenario at all
      {full, "", {"f.yaml:1: empty"}},
      {full, "[1, 2]\n", {"f.yaml:1: [1, 2]; allowed: a map"}},
      {full, "just words\n", {"f.yaml:1: just words; allowed: a map"}},
      {"  mode: realtime", "\tmode: realtime", {"f.yaml:4", "not YAML"}},
      {"kp: [40, 20]", "kp: [40, 20", {"f.yaml:3", "not YAML"}},
      {"kp: [40, 20]", "kp: !!seq [40, 20]", {"f.yaml:35: controller.gains.kp: tag"}},
      {"loop:", "---\nloop:", {"second document"}},

  };
  for (const Mutation& mutation : mutations) {
    const std::string message = refusal_of(replaced(full, mutation.from, mutation.to));
    for (const char* fragment : mutation.fragments) {
      EXPECT_THAT(message, HasSubstr(fragment)) << "for: " << mutation.to;
    }
  }
}

TEST(Scenario, MalformedReferencesAreRefused) {
  const auto with = [](const std::string& reference) {
    return refusal_of(minimal, {"reference=" + reference});
  };
  EXPECT_THAT(with("{multi_sine: {terms: []}}"),
              HasSubstr("reference.multi_sine.terms: []; allowed: a list of maps, at least one"));
  EXPECT_THAT(with("{multi_sine: {}}"), HasSubstr("reference.multi_sine.terms: missing"));
  EXPECT_THAT(with("{multi_sine: {terms: [5]}}"),
              HasSubstr("reference.multi_sine.terms[0]: 5; allowed: a map"));
  EXPECT_THAT(with("{multi_sine: {terms: [{amplitude_rad: 1, frequency_hz: 1}, {amplitude_rad: 1, "
                   "frequency_hz: -1}]}}"),
              HasSubstr("reference.multi_sine.terms[1].frequency_hz: -1; allowed:"));
  EXPECT_THAT(with("{multi_sine: {terms: [{amplitude: 1}]}}"),
              HasSubstr("reference.multi_sine.terms[0].amplitude: unknown; nearest known key is "
                        "reference.multi_sine.terms[0].amplitude_rad"));
  EXPECT_THAT(with("{point_to_point: {from_rad: 0, to_rad: 1, duration_s: 0}}"),
              AllOf(HasSubstr("reference.point_to_point.duration_s: 0"), HasSubstr("> 0")));
  EXPECT_THAT(with("{waypoints: {time_s: [0], position_rad: [0]}}"),
              HasSubstr("reference.waypoints.time_s: 1 times; allowed: at least 2"));
  EXPECT_THAT(with("{waypoints: {time_s: [0, 1, 1], position_rad: [0, 0, 0]}}"),
              HasSubstr("reference.waypoints.time_s: time 3 (1 s) is not after time 2 (1 s); "
                        "allowed: strictly increasing times"));
  EXPECT_THAT(with("{waypoints: {time_s: [0, 1], position_rad: [0]}}"),
              HasSubstr("reference.waypoints.position_rad: 1 positions; allowed: 2"));
  EXPECT_THAT(with("{waypoints: {time_s: [0, x], position_rad: [0, 1]}}"),
              HasSubstr("reference.waypoints.time_s: entry 2 of [0, x] is x"));
  EXPECT_THAT(with("{waypoints: {time_s: [0, 1], position_rad: [0, [1, 2, 3]]}}"),
              HasSubstr("[1, 2, 3] has length 3"));
  EXPECT_THAT(with("{hold: null}"), HasSubstr("reference.hold: null; allowed: a map"));
}

/// Returns the processor time to read so many waypoints. The least of three counts, as other
/// processes may interfere.
double time_to_read_waypoints(int num_waypoints) {
  std::string times, positions;
  for (int i = 0; i < num_waypoints; ++i) {
    times += (i == 0 ? "" : ", ") + std::to_string(i);
    positions += (i == 0 ? "" : ", ") + std::string("[0.1, 0.2]");
  }
  const std::string text =
      replaced(minimal, "hold: {position_rad: [0.1, 0.2]}",
               "waypoints: {time_s: [" + times + "], position_rad: [" + positions + "]}");
  double least = 1e9;
  for (int repeat = 0; repeat < 3; ++repeat) {
    const std::clock_t start = std::clock();
    const Scenario scenario = parsed(text);
    least = std::min(least, double(std::clock() - start) / CLOCKS_PER_SEC);
    EXPECT_EQ(std::get<trajectory::Waypoints>(scenario.reference).time_s.size(),
              static_cast<std::size_t>(num_waypoints));
  }
  return least;
}

TEST(Scenario, ReadingWaypointsTakesTimeInProportionToTheirNumber) {
  // Linear time gives 16, quadratic time 256. A busy machine changes the ratio by a factor of 2.
  EXPECT_LT(time_to_read_waypoints(3200) / time_to_read_waypoints(200), 64);
}

TEST(Scenario, ARandomlyDamagedOneIsReadOrRefusedAndNothingElse) {
  std::mt19937 random(1);
  int num_refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = full;
    for (int damage = 0; damage <= i % 4; ++damage) {
      const std::size_t at = random() % text.size();
      switch (random() % 4) {
        case 0:
          text[at] = static_cast<char>(random() % 256);
          break;
        case 1:
          text.erase(at, random() % 20);
          break;
        case 2:
          text.insert(at, std::string(1 + random() % 3, "[]{}:,&*#!|>-'\"%@` \n"[random() % 20]));
          break;
        default:
          text.insert(at, text.substr(random() % text.size(), random() % 40));
          break;
      }
    }
    try {
      const Scenario read = parsed(text);
      expect_same(parse_scenario(read.text, urdf, "a log"), read);
    } catch (const base::Failure& failure) {
      ++num_refused;
      EXPECT_THAT(failure.what(), StartsWith("f.yaml")) << text;
    }
  }
  EXPECT_GT(num_refused, 1000);
}

// ---- overrides -------------------------------------------------------------------------------

TEST(Scenario, AnOverrideTakesThePlaceOfTheFilesValue) {
  const Scenario s = parsed(full, {"loop.period_s=5e-4", "controller.gains.kp=7",
                                   "controller.gains.new=[1, 2]", "loop.period_s=2e-3"});
  EXPECT_EQ(s.loop.period_s, 2e-3);
  EXPECT_EQ(s.loop.num_ticks, 1250);
  EXPECT_THAT(values(s.controller.gains.at("kp")), ElementsAre(7, 7));
  EXPECT_THAT(values(s.controller.gains.at("new")), ElementsAre(1, 2));
  EXPECT_TRUE(std::holds_alternative<trajectory::Hold>(
      parsed(full, {"reference={hold: {position_rad: 0}}"}).reference));
}

TEST(Scenario, AnOverrideIsNamedAsTheSourceOfItsError) {
  EXPECT_THAT(refusal_of(full, {"loop.period_s=-1"}),
              StartsWith("--set loop.period_s=-1: loop.period_s: -1; allowed: a finite number"));
  EXPECT_THAT(refusal_of(full, {"loop.perod_s=1"}),
              StartsWith("--set loop.perod_s=1: loop.perod_s: unknown; nearest known key is "
                         "loop.period_s"));
  EXPECT_THAT(refusal_of(full, {"reference={sinusoid: {amplitude_rad: 1}}"}),
              AllOf(StartsWith("--set reference="), HasSubstr("frequency_hz: missing")));
  EXPECT_THAT(refusal_of(full, {"reference.hold.position_rad=0"}),
              HasSubstr("both hold and sinusoid"));
  EXPECT_THAT(refusal_of(full, {"loop"}), HasSubstr("write key.path=value"));
}

// ---- text and digest -------------------------------------------------------------------------

TEST(Scenario, ItsTextGivesTheSameScenarioAgain) {
  for (const char* text : {minimal, full}) {
    const Scenario first =
        parsed(text, {"plant.integrator.accuracy=1.00000000000000005e-9", "robot.joints=rigid",
                      "reference={multi_sine: {terms: [{amplitude_rad: 0.1, frequency_hz: 1}]}}"});
    EXPECT_THAT(first.text, HasSubstr("1.00000000000000005e-9"));
    expect_same(parse_scenario(first.text, first.robot.urdf_text, "a log"), first);
  }
}

TEST(Scenario, DigestChangesWithAnyValueAndTheUrdfButNotWithComments) {
  const Scenario base = parsed(full);
  EXPECT_EQ(parsed("# a comment\n" + std::string(full)).digest, base.digest);
  EXPECT_NE(parsed(full, {"loop.give_up_s=3"}).digest, base.digest);
  EXPECT_NE(parsed(full, {"controller.gains.kd=[4, 2.0000001]"}).digest, base.digest);
  EXPECT_NE(parse_scenario(full, replaced(urdf, "0.01", "0.010"), "f.yaml").digest, base.digest);
  EXPECT_EQ(parse_scenario(full, std::string(urdf) + " ", "f.yaml").digest, base.digest);
  EXPECT_EQ(parsed(full, {"loop.give_up_s=2"}).digest, base.digest);
}

TEST(Scenario, DigestIsFnv1a) {
  // Two builds must agree: FNV-1a of text, a zero byte and the URDF, computed a second time.
  const Scenario s = parsed(minimal);
  std::uint64_t hash = 14695981039346656037ULL;
  for (const unsigned char c : s.text + '\0' + s.robot.urdf_text) {
    hash = (hash ^ c) * 1099511628211ULL;
  }
  EXPECT_EQ(static_cast<std::uint64_t>(s.digest), hash);
}

// ---- complaint -------------------------------------------------------------------------------

TEST(Scenario, AComplaintNamesLineOrOverrideOfTheKeyOrOfTheMapItIsMissingFrom) {
  const Scenario s = parsed(full, {"controller.gains.kp=7"});
  EXPECT_STREQ(s.complaint("controller.gains.kd", "no").what(),
               "f.yaml:36: controller.gains.kd: no");
  EXPECT_STREQ(s.complaint("controller.gains.ki", "missing").what(),
               "f.yaml:34: controller.gains.ki: missing");
  EXPECT_STREQ(s.complaint("controller.gains.kp", "no").what(),
               "--set controller.gains.kp=7: controller.gains.kp: no");
  EXPECT_STREQ(s.complaint("elsewhere", "no").what(), "f.yaml: elsewhere: no");
  EXPECT_EQ(s.complaint("name", "no").code(), base::ExitCode::bad_usage);
}

// ---- files -----------------------------------------------------------------------------------

class ScenarioFile : public ::testing::Test {
 protected:
  void SetUp() override {
    write("two.urdf", urdf);
    write("a.yaml", minimal);
  }

  void write(const std::string& name, const std::string& text) {
    std::ofstream(directory_ / name, std::ios::binary) << text;
  }
  std::string refusal_of_file(const std::string& name,
                              const std::vector<std::string>& overrides = {}) {
    return refusal([&] { load_scenario(directory_ / name, overrides); });
  }

  TemporaryDirectory directory_;
};

TEST_F(ScenarioFile, NamesItsUrdfRelativeToItself) {
  const Scenario s = load_scenario(directory_ / "a.yaml");
  EXPECT_EQ(s.robot.urdf_text, robot::urdf_mechanics(urdf, ""));
  EXPECT_EQ(s.source, (directory_ / "a.yaml").string());
  EXPECT_EQ(
      load_scenario(directory_ / "a.yaml", {"robot.urdf=" + (directory_ / "two.urdf").string()})
          .robot.urdf_text,
      s.robot.urdf_text);
}

TEST_F(ScenarioFile, ThatCannotBeReadIsRefused) {
  const std::string here = directory_.path().string();
  EXPECT_EQ(refusal_of_file("none.yaml"), here + "/none.yaml: no such file");
  std::filesystem::create_directory(directory_ / "d.yaml");
  EXPECT_THAT(refusal_of_file("d.yaml"), StartsWith(here + "/d.yaml: is a directory"));
  write("huge.yaml", minimal + std::string(1'000'000, '#'));
  EXPECT_THAT(refusal_of_file("huge.yaml"),
              AllOf(StartsWith(here + "/huge.yaml: too large"), HasSubstr("1000000 bytes")));
  write("empty.yaml", "");
  EXPECT_THAT(refusal_of_file("empty.yaml"), StartsWith(here + "/empty.yaml:1: empty"));
  write("binary.yaml", std::string("name: a\n\0\1\2", 11));
  EXPECT_THAT(refusal_of_file("binary.yaml"), HasSubstr("binary.yaml:2: control character 0"));
}

TEST_F(ScenarioFile, WhoseUrdfIsMissingOrRefusedSaysSo) {
  EXPECT_THAT(refusal_of_file("a.yaml", {"robot.urdf=none.urdf"}),
              AllOf(StartsWith("--set robot.urdf=none.urdf: robot.urdf: "),
                    HasSubstr("none.urdf: no such file")));
  write("bad.urdf", "<robot name=\"x\"><link name=\"a\"/>");
  write("b.yaml", replaced(minimal, "two.urdf", "bad.urdf"));
  EXPECT_THAT(
      refusal_of_file("b.yaml"),
      AllOf(StartsWith((directory_ / "b.yaml:3: robot.urdf: ").string()), HasSubstr("bad.urdf")));
  write("still.urdf", "<robot name=\"x\"><link name=\"a\"/></robot>");
  EXPECT_THAT(refusal_of_file("a.yaml", {"robot.urdf=still.urdf"}), HasSubstr("still.urdf"));
}

TEST_F(ScenarioFile, ThatIsXmlIsAnsweredByWhatItIs) {
  EXPECT_THAT(refusal_of_file("two.urdf"), HasSubstr("two.urdf --write SCENARIO.yaml makes a"));
  write("a.xacro", "\n<robot xmlns:xacro='http://ros.org/wiki/xacro'/>");
  EXPECT_THAT(refusal_of_file("a.xacro"), HasSubstr("a.xacro > robot.urdf and give robot.urdf"));
  write("a.sdf", "<sdf version='1.6'/>");
  EXPECT_THAT(refusal_of_file("a.sdf"), HasSubstr("a.sdf: an SDF file"));
  write("a.xml", "\xef\xbb\xbf<mujoco/>");
  EXPECT_THAT(refusal_of_file("a.xml"), HasSubstr("a.xml: a model of MuJoCo"));
}

TEST(UrdfScenario, MovesAQuarterOfTheRangeAwayFromTheLimits) {
  robot::Model model = robot::model_from_urdf(urdf, "t");
  for (const auto& [lower, upper] : {std::pair{-1.0, 0.1}, {0.2, 0.9}, {-0.4, 0.4}, {-3.0, -1.0}}) {
    model.lower = Vector::Constant(2, lower);
    model.upper = Vector::Constant(2, upper);
    const Scenario s = parsed(urdf_scenario(model, {"bare", "two.urdf"}));
    const auto& moves = std::get<reference::trajectory::PointToPoint>(s.reference);
    const double room = 0.2499 * (upper - lower);  // six digits in the file
    for (const Vector& q : {moves.from_rad, moves.to_rad}) {
      EXPECT_GE(q[0], lower + room);
      EXPECT_LE(q[0], upper - room);
    }
    EXPECT_NE(moves.from_rad[0], moves.to_rad[0]);
  }
}

TEST(UrdfScenario, HasIdealEncodersWhereAJointThatSlidesHasNoRange) {
  robot::Model model = robot::model_from_urdf(urdf, "t");
  model.joint_types[0] = robot::JointType::prismatic;
  model.lower[0] = -1;
  model.upper[0] = 1;
  EXPECT_THAT(urdf_scenario(model, {"bare", "two.urdf"}), HasSubstr("resolution_bits: 20}"));
  model.lower[0] = -std::numeric_limits<double>::infinity();
  const std::string text = urdf_scenario(model, {"bare", "two.urdf"});
  EXPECT_THAT(text, HasSubstr("resolution_bits: null}"));
  EXPECT_FALSE(parsed(text).plant.encoder.resolution_bits);
}

TEST(UrdfScenario, BeginsWhereNoLinkIsBelowTheBaseAndFeedsTheFrictionForward) {
  robot::Model model = *load_scenario(TACHLESS_SOURCE_DIR "/scenarios/ur5e.yaml").model;
  model.damping = Vector::Constant(6, 0.5);
  model.friction = Vector::Constant(6, 2);
  const auto lowest = [&](const Vector& q) {
    double z = 0;
    for (const auto& [name, frame] : model.frames) {
      z = std::min(z, robot::frame_pose(model, frame, q).p.z());
    }
    return z;
  };
  model.lower[1] = -1.5;  // the upper arm hangs down in the middle of this range
  model.upper[1] = 2.5;
  const Vector middle = 0.5 * (model.lower + model.upper);
  EXPECT_LT(lowest(middle), -1e-3);
  const std::string text = urdf_scenario(model, {"arm", "ur5e.urdf"});
  EXPECT_THAT(text, AllOf(HasSubstr("viscous: [0.5, 0.5"), HasSubstr("coulomb: [2, 2"),
                          HasSubstr("torque: hold")));
  const auto numbers = [&](const std::string& key) {
    Vector q(6);
    std::istringstream list(text.substr(text.find(key) + key.size()));
    char comma = 0;
    for (double& each : q) list >> each >> comma;
    return q;
  };
  const Vector from = numbers("from_rad: ["), to = numbers("to_rad: [");
  EXPECT_NE(from, to);
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    EXPECT_GE(lowest(from + share * (to - from)), -1.1e-3);  // six digits in the file
  }
  const Vector chosen = Vector::Constant(6, 0.1);
  EXPECT_THAT(urdf_scenario(model, {"arm", "ur5e.urdf", 1e-3, chosen}),
              HasSubstr("from_rad: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]"));
}

TEST_F(ScenarioFile, CarriesOfItsUrdfWhatIsReadWhateverItsVisuals) {
  write("big.urdf", std::string(urdf) + "<!--" + std::string(60'000, ' ') + "-->");
  EXPECT_EQ(load_scenario(directory_ / "a.yaml", {"robot.urdf=big.urdf"}).robot.urdf_text,
            robot::urdf_mechanics(urdf, ""));
}

TEST_F(ScenarioFile, ThatDoesNotFitOneMessageWithItsUrdfIsRefused) {
  write("big.urdf", replaced(urdf, "name=\"two\"", "name=\"" + std::string(60'000, 'a') + "\""));
  EXPECT_THAT(refusal_of_file("a.yaml", {"robot.urdf=big.urdf"}),
              AllOf(HasSubstr("robot.urdf: "), HasSubstr("60000 bytes"), HasSubstr("shorten")));
}

TEST(Scenario, ReadsItsRobotLockedAndHung) {
  const Scenario s =
      parsed(replaced(minimal, "[0.1, 0.2]", "[0.1]"),
             {"robot.locked={elbow: 0.5}", "robot.base={rpy: [3.141592653589793, 0, 0]}",
              "controller.gains={kp: 1, kd: 3}"});
  EXPECT_EQ(s.num_joints, 1);
  EXPECT_EQ(s.robot.locked.at("elbow"), 0.5);
  // The shoulder's axis and the world's z: y and -z of the root link.
  EXPECT_NEAR(s.model->bodies[0].R_PB(2, 2), -1, 1e-15);
  EXPECT_THAT(refusal_of(minimal, {"robot.locked={wrist: 0}"}),
              AllOf(HasSubstr("robot.locked: there is no joint 'wrist'"), HasSubstr("elbow")));
  EXPECT_THAT(refusal_of(minimal, {"robot.locked={elbow: bent}"}),
              HasSubstr("robot.locked.elbow: bent; allowed: a finite number"));
  EXPECT_THAT(refusal_of(minimal, {"robot.base.xyz=[1, 2]"}),
              HasSubstr("robot.base.xyz: 2 numbers; allowed: 3"));
}

TEST(Scenario, LetsImpossibleInertiasPassWhenToldTo) {
  const std::string impossible = replaced(urdf, "iyy=\"0.1\"", "iyy=\"0.3\"");
  try {
    (void)parse_scenario(minimal, impossible, "f.yaml");
    ADD_FAILURE() << "accepted";
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(),
                AllOf(HasSubstr("f.yaml:3: robot.urdf: "), HasSubstr("link 'upper'"),
                      HasSubstr("robot.check_inertia: warn")));
  }
  const std::string warn = "robot.check_inertia=warn";
  const Scenario s = parse_scenario(minimal, impossible, "f.yaml", {warn});
  // Simbody refuses such a body.
  EXPECT_EQ(s.plant.mechanics, plant::Mechanics::native);
  EXPECT_THAT(s.model->warnings,
              ElementsAre(HasSubstr("link 'upper'"), HasSubstr("plant.mechanics is native")));
  EXPECT_THROW(
      (void)parse_scenario(minimal, impossible, "f.yaml", {warn, "plant.mechanics=simbody"}),
      base::Failure);
}

TEST(Scenario, RotorsAreInertiaEnoughForALinkWithoutAny) {
  std::string hollow = urdf;
  const std::size_t at = hollow.rfind("<inertial>"), end = hollow.rfind("</inertial>") + 11;
  hollow.erase(at, end - at);
  EXPECT_THROW((void)parse_scenario(minimal, hollow, "f.yaml"), base::Failure);
  EXPECT_EQ(parse_scenario(minimal, hollow, "f.yaml",
                           {"robot.joints={rigid: {rotor_inertia_kgm2: [0, 0.1]}}"})
                .num_joints,
            2);
}

TEST(Scenario, ViscousFrictionIsTheUrdfsDampingUnlessGiven) {
  const std::string damped =
      replaced(urdf, "<limit", "<dynamics damping=\"0.5\" friction=\"1\"/><limit");
  const auto friction = [&](const std::vector<std::string>& overrides) {
    return values(parse_scenario(minimal, damped, "f.yaml", overrides)
                      .plant.drive.viscous_friction_Nms_per_rad);
  };
  EXPECT_THAT(friction({}), ElementsAre(0, 0.5));
  EXPECT_THAT(friction({"plant.drive.viscous_friction_Nms_per_rad=0"}), ElementsAre(0, 0));
}

TEST(Scenario, CoulombFrictionIsTheUrdfsUnlessGiven) {
  const std::string rubbing =
      replaced(urdf, "<limit", "<dynamics damping=\"0.5\" friction=\"1\"/><limit");
  const auto read = [&](const std::vector<std::string>& overrides) {
    return parse_scenario(minimal, rubbing, "f.yaml", overrides);
  };
  const Scenario s = read({});
  EXPECT_THAT(values(s.plant.drive.coulomb_friction_Nm), ElementsAre(0, 1));
  EXPECT_EQ(s.plant.mechanics, plant::Mechanics::simbody);
  EXPECT_THAT(s.model->warnings, ::testing::IsEmpty());
  const Scenario none = read({"plant.drive.coulomb_friction_Nm=0"});
  EXPECT_FALSE(none.plant.drive.dry_friction());
  EXPECT_THAT(refusal([&] { read({"plant.drive.static_friction_Nm=0.5"}); }),
              HasSubstr("plant.drive.static_friction_Nm: 0.5 of joint elbow is below its Coulomb"));
  EXPECT_THAT(refusal([&] { read({"plant.drive.friction_rise_Nm=[0, -1.5]"}); }),
              HasSubstr("-1.5 of joint elbow: friction would drive it; allowed: at least -1"));
  EXPECT_THAT(refusal([&] { read({"plant.drive.load_friction=0.1"}); }),
              HasSubstr("plant.drive.load_friction: 0.1 of joint shoulder, which has no other"));
  EXPECT_TRUE(read({"plant.drive.friction_rise_Nm=[0, -1]"}).plant.drive.dry_friction());
}

TEST(Scenario, OfAnArmThatCompensatesHasAHoldingStartAndTheRestOfTheFriction) {
  const std::string rubbing =
      replaced(urdf, "<limit", "<dynamics damping=\"0.5\" friction=\"1\"/><limit");
  const auto read = [&](const std::string& compensates, const std::string& other) {
    return parse_scenario(minimal, rubbing, "f.yaml", {"robot.compensates=" + compensates, other});
  };
  const Scenario gravity = read("{gravity: true}", "controller.friction.coulomb=2");
  EXPECT_EQ(gravity.plant.initial.torque, plant::InitialTorque::hold);
  EXPECT_TRUE(gravity.plant.drive.dry_friction());
  EXPECT_TRUE(gravity.controller.friction.given());
  const Scenario both = read("{gravity: true, friction: 1}", "controller.friction.coulomb=2");
  EXPECT_FALSE(both.plant.drive.dry_friction());
  EXPECT_THAT(values(both.plant.drive.viscous_friction_Nms_per_rad), ElementsAre(0, 0));
  EXPECT_FALSE(both.controller.friction.given());
  EXPECT_THAT(refusal([&] { read("{gravity: true}", "plant.initial.torque=zero"); }),
              HasSubstr("plant.initial.torque: zero, but an arm that adds gravity itself"));
  const Scenario half = read("{friction: 0.5}", "controller.friction.coulomb=2");
  EXPECT_THAT(values(half.plant.drive.coulomb_friction_Nm), ElementsAre(0, 0.5));
  EXPECT_THAT(values(half.controller.friction.coulomb), ElementsAre(1, 1));
  EXPECT_THAT(refusal([&] { read("{coriolis: true, base_rpy: [0, 0, 0]}", "name=a"); }),
              HasSubstr("robot.compensates.base_rpy: given, but the arm adds no gravity"));
  EXPECT_THAT(refusal([&] { read("{gravity: true, base_rpy: [0, 1]}", "name=a"); }),
              HasSubstr("robot.compensates.base_rpy: 2 numbers; allowed: 3"));
  EXPECT_THAT(refusal([&] { read("{friction: 1, urdf: a.urdf}", "name=a"); }),
              HasSubstr("robot.compensates.urdf: given, but the arm adds no torque of a model"));
  EXPECT_THAT(refusal([&] { read("gravity", "name=a"); }),
              HasSubstr("robot.compensates: gravity; allowed: a map"));
  EXPECT_THAT(refusal([&] { read("{gravity: true}", "robot.joint_signs=[1, 0]"); }),
              HasSubstr("robot.joint_signs: 0; allowed: 1 and -1"));
}

TEST(Scenario, RefusesAPayloadAndDisturbancesThatMakeNoSense) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"payload={mass_kg: 1, link: hand}", "plant.payload.link: \"hand\" is not in the URDF"},
      {"payload={mass_kg: 1, inertia_kgm2: [1, 0, 0]}", "inertia_kgm2: 3 numbers; allowed: 6"},
      {"payload={mass_kg: 1, inertia_kgm2: [1, 0, 0, 1, 0, 9]}", "triangle inequality"},
      {"payload={mass_kg: 1, center_of_mass_m: [0]}", "center_of_mass_m: 1 numbers; allowed: 3"},
      {"disturbances=[{torque_Nm: 1}]", "plant.disturbances[0].joint: neither a joint nor a link"},
      {"disturbances=[{joint: elbow, link: lower, torque_Nm: 1}]", "[0].joint: and a link"},
      {"disturbances=[{joint: elbow, force_N: [1, 0, 0]}]", "[0].torque_Nm: a joint takes"},
      {"disturbances=[{joint: elbow, torque_Nm: 1}, {link: lower, torque_Nm: 1}]",
       "plant.disturbances[1].torque_Nm: a joint takes torque_Nm, a link force_N"},
      {"disturbances=[{link: lower, force_N: [1]}]", "[0].force_N: 1 numbers; allowed: 3"},
      {"disturbances=[{link: hand, force_N: [1, 0, 0]}]", "[0].link: \"hand\" is not in the URDF"},
      {"disturbances=[{joint: wrist, torque_Nm: 1}]", "[0].joint: \"wrist\" is no joint of the"},
      {"disturbances=[{joint: elbow, torque_Nm: 1, shape: pulse}]", "[0].end_s: missing; a pulse"},
      {"disturbances=[{joint: elbow, torque_Nm: 1, start_s: 1, end_s: 1}]", "end_s: not after"},
      {"disturbances=[{joint: elbow, torque_Nm: 1, shape: sinusoid}]", "[0].frequency_hz: a sinus"},
      {"disturbances=[{joint: elbow, torque_Nm: 1, shape: square}]",
       "one of constant, pulse, sinusoid"},
      {"disturbances=[{joint: elbow, torque: 1}]", "[0].torque: unknown; nearest known key is "}};
  for (const auto& [override, expected] : cases) {
    EXPECT_THAT(refusal_of(minimal, {"plant." + override}), HasSubstr(expected)) << override;
  }
}

TEST_F(ScenarioFile, MayGiveTheControllerAnotherRobotWhichTravelsWithIt) {
  write("heavy.urdf", replaced(urdf, "<mass value=\"", "<mass value=\"1"));
  const Scenario s = load_scenario(directory_ / "a.yaml", {"controller.urdf=heavy.urdf"});
  ASSERT_TRUE(s.believed_model);
  EXPECT_GT(s.believed_model->bodies[0].mass, s.model->bodies[0].mass + 5);
  const Scenario again = parse_scenario(s.text, s.robot.urdf_text, "a log");
  EXPECT_EQ(again.digest, s.digest);
  EXPECT_EQ(again.robot.urdf_text, s.robot.urdf_text);
  EXPECT_EQ(again.model->bodies[0].mass, s.model->bodies[0].mass);
  EXPECT_EQ(again.believed_model->bodies[0].mass, s.believed_model->bodies[0].mass);
  EXPECT_FALSE(load_scenario(directory_ / "a.yaml").believed_model);

  write("other.urdf", replaced(urdf, "\"elbow\"", "\"knee\""));
  EXPECT_THAT(refusal_of_file("a.yaml", {"controller.urdf=other.urdf"}),
              AllOf(HasSubstr("controller.urdf: its joints are shoulder, knee; allowed: "),
                    HasSubstr("shoulder, elbow")));
  std::ofstream(directory_ / "empty.urdf");  // as a pipe leaves it whose program failed
  EXPECT_THAT(refusal_of_file("a.yaml", {"controller.urdf=empty.urdf"}),
              HasSubstr("controller.urdf: "));
  EXPECT_THAT(refusal_of_file("a.yaml", {"controller.urdf=none.urdf"}),
              HasSubstr("none.urdf: no such file"));
  EXPECT_THAT(refusal([&] {
                parse_scenario(minimal, s.robot.urdf_text, "a log", {"controller.urdf=x.urdf"});
              }),
              HasSubstr("controller.urdf: its file is not read here"));
}

TEST(ShippedScenarios, AreRead) {
  int num_scenarios = 0;
  for (const auto& file : std::filesystem::directory_iterator(TACHLESS_SOURCE_DIR "/scenarios")) {
    if (file.path().extension() != ".yaml") continue;
    ++num_scenarios;
    SCOPED_TRACE(file.path());
    const Scenario s = load_scenario(file.path());
    EXPECT_EQ(s.name, file.path().stem().string());
    expect_same(parse_scenario(s.text, s.robot.urdf_text, "a log"), s);
  }
  EXPECT_GE(num_scenarios, 8);
}

}  // namespace
}  // namespace tachless::scenario
