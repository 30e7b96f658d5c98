// The law in a loop of one's own, with its certificate, bounds and guards.
#include "own_loop/own_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "scenario/scenario.h"
#include "tests/support/counting_new.h"
#include "tests/support/temporary_directory.h"

namespace tachless::own_loop {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Words = std::vector<std::string>;

const std::string scenarios = TACHLESS_SOURCE_DIR "/scenarios/";
const std::string two_link = scenarios + "practical_rigid.yaml";
const std::string seven_joints = scenarios + "iiwa_point_to_point.yaml";
const std::vector<double> seven_start = {0, 0.3, 0, -1.0, 0, 0.8, 0};

std::vector<double> numbers(const Numbers& view) { return {view.begin(), view.end()}; }

/// A reference of two joints that stands still.
struct Resting {
  std::array<double, 2> position{0, 0}, zero{0, 0};
  [[nodiscard]] Reference view() const { return {position, zero, zero}; }
};

const ReferenceBounds slow{.speed = {1}, .acceleration = {5}, .lower = {-1}, .upper = {1}};

std::string refusal_of(const std::string& file, const Words& set) {
  try {
    const CertifiedLoop loop(file, set);
  } catch (const NotCertified& refused) {
    return refused.what();
  }
  return "";
}

TEST(CertifiedLoop, SaysWhatIsCertified) {
  const CertifiedLoop loop(two_link);
  EXPECT_THAT(loop.certificate().text,
              HasSubstr("stable at 1 kHz with 1 tick of delay: limit 3.6"));
  EXPECT_NEAR(loop.certificate().limit_s, 3.6e-3, 0.1e-3);
  EXPECT_GT(loop.certificate().settling_s, 0);
  EXPECT_EQ(loop.certificate().stiffness.size(), 2U);
  EXPECT_EQ(loop.period_s(), 1e-3);
  EXPECT_EQ(loop.joints(), (Words{"shoulder", "elbow"}));
}

TEST(CertifiedLoop, IsRefusedAtAnUnstablePeriodInWordsForAProgram) {
  const std::string refusal = refusal_of(two_link, {"loop.period_s=0.006"});
  EXPECT_THAT(refusal, AllOf(HasSubstr("no certificate: unstable at 166.7 Hz"),
                             HasSubstr("; take a period of 0.002 s or choose softer gains"),
                             Not(HasSubstr("--"))));
}

TEST(CertifiedLoop, IsRefusedForALawWithoutALinearisation) {
  EXPECT_THAT(refusal_of(two_link, {"controller.law=robust_differentiator",
                                    "controller.gains={kp: 4000, kd: 400, lipschitz: 100}"}),
              HasSubstr("cannot be linearised"));
}

TEST(CertifiedLoop, IsRefusedForALawThatMeasuresVelocity) {
  EXPECT_THROW(CertifiedLoop(two_link, {"controller.law=slotine_li",
                                        "controller.gains={lambda: 10, kd: 60}"}),
               std::runtime_error);
}

class WithoutAnExperiment : public testing::Test {
 protected:
  std::string file(const std::string& more = "") {
    const std::string path = (directory_ / "arm.yaml").string();
    std::ofstream(path) << "name: arm\nrobot: {urdf: " << scenarios
                        << "robots/two_link.urdf}\ncontroller:\n  law: loria_ortega_rigid\n"
                           "  gains: {kp: [40000, 2400], kd: [1000, 60], a: 1000, b: 1000}\n"
                           "  filter: tustin\n"
                        << more;
    return path;
  }
  TemporaryDirectory directory_;
};

TEST_F(WithoutAnExperiment, NeedsNeitherReferenceNorDuration) {
  Loop loop(file("loop: {period_s: 0.0007}\n"));
  EXPECT_FALSE(loop.has_reference());
  const std::array<double, 2> q{0.1, 0};
  const Step refused = loop.torque(0, q);
  EXPECT_EQ(refused.status, Status::no_reference);
  EXPECT_THAT(loop.reason(refused), HasSubstr("tick 0 has no reference"));
  EXPECT_TRUE(loop.torque(0, q, Resting().view()).ok());
}

TEST_F(WithoutAnExperiment, TakesADurationThatIsNoWholeNumberOfPeriods) {
  EXPECT_EQ(Loop(two_link, {"loop.period_s=0.0015"}).period_s(), 0.0015);
}

TEST_F(WithoutAnExperiment, RefusesWrongValuesAllTheSame) {
  EXPECT_THROW(Loop(file("loop: 5\n")), std::runtime_error);
  EXPECT_THROW(Loop(file("loop: {duration_s: soon}\n")), std::runtime_error);
  EXPECT_THROW(Loop(file("loop: {period_s: -1}\n")), std::runtime_error);
  EXPECT_THROW(Loop(file("plant: {initial: 3}\n")), std::runtime_error);
  EXPECT_THROW(Loop(file("motion: 3\n")), std::runtime_error);
}

TEST_F(WithoutAnExperiment, IsCertifiedByBoundsAndByNothingElse) {
  EXPECT_THROW(CertifiedLoop{file()}, std::runtime_error);
  CertifiedLoop loop(file(), slow);
  EXPECT_THAT(loop.certificate().text, HasSubstr("as fast as the bounds"));
  EXPECT_TRUE(loop.torque(0, Resting().position, Resting().view()).ok());
}

TEST_F(WithoutAnExperiment, HasTheTorquesOfTheSameLawOfARobotsFile) {
  // The file has the keys that the command design writes for a bare URDF.
  Loop of_robot(LawSettings{.urdf = scenarios + "robots/two_link.urdf",
                            .gains = {{"kp", {40000, 2400}},
                                      {"kd", {1000, 60}},
                                      {"a", {1000, 1000}},
                                      {"b", {1000, 1000}}},
                            .period_s = 0.002});
  Loop of_file(file("  feedforward_lead: half_tick_plus_delay\nloop: {period_s: 0.002}\n"));
  Resting reference;
  for (int k = 0; k < 20; ++k) {
    reference.position = {0.1 + 0.001 * k, 0.002 * k};
    const std::array<double, 2> q{0.1, 0.001 * k};
    const Step step = of_robot.torque(k, q, reference.view());
    ASSERT_TRUE(step.ok()) << of_robot.reason(step);
    ASSERT_EQ(numbers(step.tau), numbers(of_file.torque(k, q, reference.view()).tau));
  }
}

TEST_F(WithoutAnExperiment, RefusesWrongSettingsWithTheirNames) {
  const auto refusal = [](const ReferenceBounds& bounds) -> std::string {
    try {
      const CertifiedLoop loop(two_link, bounds);
    } catch (const std::runtime_error& refused) {
      return refused.what();
    }
    return "";
  };
  EXPECT_THAT(refusal({.speed = {1, 1, 1}, .acceleration = {1}}), HasSubstr("bounds.speed: 3"));
  EXPECT_THAT(refusal({.speed = {1}, .acceleration = {}}), HasSubstr("bounds.acceleration"));
  EXPECT_THAT(refusal({.speed = {1}, .acceleration = {1}, .lower = {1}, .upper = {-1}}),
              HasSubstr("joint 1 (shoulder) from 1 to -1"));
  EXPECT_THROW(Loop(LawSettings{.urdf = two_link, .gains = {}}), std::runtime_error);
  EXPECT_THROW(Loop("nowhere.yaml"), std::runtime_error);
}

TEST(Bounds, AreCheckedAtEachStepWithTheWayFromTheOneBefore) {
  CertifiedLoop loop(two_link, slow);
  const std::array<double, 2> q{0, 0}, zero{0, 0};
  const auto joint_beyond = [&](std::int64_t tick, std::array<double, 2> position,
                                std::array<double, 2> velocity,
                                std::array<double, 2> acceleration) {
    const Step step = loop.torque(tick, q, {position, velocity, acceleration});
    EXPECT_TRUE(step.has_torque());
    EXPECT_EQ(step.ok(), step.joint < 0);
    if (!step.ok()) {
      EXPECT_THAT(loop.reason(step), HasSubstr("beyond its bounds"));
    }
    return step.joint;
  };
  EXPECT_EQ(joint_beyond(0, {0, 0.9}, zero, {0, 5}), -1);
  EXPECT_EQ(joint_beyond(1, {0, 0.9}, zero, {0, 5.1}), 1);    // acceleration
  EXPECT_EQ(joint_beyond(2, {0.0011, 0.9}, zero, zero), 0);   // 1.1 mm in a tick of 1 ms at 1 rad/s
  EXPECT_EQ(joint_beyond(4, {0.0031, 0.9}, zero, zero), -1);  // 2 mm in two ticks
  EXPECT_EQ(joint_beyond(5, {0.0031, 0.9}, {0.01, 0}, zero), 0);  // a velocity that jumps
  loop.reset();
  EXPECT_EQ(joint_beyond(0, {-1, -1}, {-1, 1}, zero), -1);  // none before
  loop.reset();
  EXPECT_EQ(joint_beyond(0, {-1.01, 0}, zero, zero), 0);  // box
  loop.reset();
  EXPECT_EQ(joint_beyond(0, {0, 0}, {0, 1.01}, zero), 1);  // speed
}

TEST(Bounds, CountTheWayFromTheCallersLastReference) {
  CertifiedLoop loop(two_link, slow);
  Resting reference;
  for (int k = 0; k < 9; ++k) {
    reference.position[0] = 1e-3 * k;  // 1 rad/s, in every third tick
    const Step step = k % 3 == 0 ? loop.torque(k, reference.position, reference.view())
                                 : loop.torque(k, reference.position);
    EXPECT_TRUE(step.ok()) << k << loop.reason(step);
  }
}

TEST(Bounds, AreNeededForACallersReferenceUnderACertificate) {
  CertifiedLoop loop(two_link);
  const Step step = loop.torque(0, Resting().position, Resting().view());
  EXPECT_EQ(step.status, Status::beyond_bounds);
  EXPECT_THAT(loop.reason(step), HasSubstr("give the constructor the bounds"));
  Loop uncertified(two_link);
  EXPECT_TRUE(uncertified.torque(0, Resting().position, Resting().view()).ok());
}

TEST(Bounds, OfABoxWithAnUnstablePostureAreRefused) {
  // Stretched out, the shoulder has the largest inertia and the lowest resonance: soft gains are
  // stable there; folded up, they are not at this period.
  const Words set = {"loop.period_s=0.0036", "robot.gravity_m_per_s2=0"};
  EXPECT_NO_THROW(CertifiedLoop(two_link, ReferenceBounds{{1}, {5}, {-0.01}, {0.01}}, {}));
  const CertifiedLoop narrow(two_link, ReferenceBounds{{1}, {5}, {-0.01}, {0.01}});
  const CertifiedLoop wide(two_link, ReferenceBounds{{1}, {5}, {-3}, {3}});
  EXPECT_LT(wide.certificate().limit_s, narrow.certificate().limit_s);
  const double between = 0.5 * (wide.certificate().limit_s + narrow.certificate().limit_s);
  const Words period = {"loop.period_s=" + std::to_string(between)};
  EXPECT_NO_THROW(CertifiedLoop(two_link, ReferenceBounds{{1}, {5}, {-0.01}, {0.01}}, period));
  EXPECT_THROW(CertifiedLoop(two_link, ReferenceBounds{{1}, {5}, {-3}, {3}}, period), NotCertified);
}

TEST(Loop, StepsOverMissedReadingsAsTheControllerDoesInRealtime) {
  scenario::Scenario scenario = scenario::load_scenario(two_link);
  scenario.loop.mode = scenario::Mode::realtime;
  const controller::ScenarioLaw law = controller::scenario_law(scenario);
  const reference::Trajectory trajectory(scenario.reference);
  Loop loop(two_link);
  std::int64_t before = -1;
  for (const int tick : {0, 1, 2, 5, 6, 26, 27, 200, 201}) {
    const Vector q = Vector::Constant(2, 0.01 * std::sin(0.3 * tick));
    messages::AnyMeasurement measured = messages::PositionMeasurement{q};
    const controller::Outcome outcome = law->step(tick, measured, trajectory.at(tick * 1e-3));
    const Step step = loop.torque(tick, q);
    ASSERT_EQ(numbers(step.tau), numbers(outcome.command.tau)) << tick;
    EXPECT_EQ(step.skipped, tick - before - 1);
    EXPECT_EQ(step.restarted,
              tick == 200);  // the 173 ticks before are more than the law steps over
    before = tick;
  }
}

TEST(Loop, BeginsAnewAfterAReset) {
  Loop loop(two_link);
  const auto run = [&] {
    std::vector<std::vector<double>> torques;
    for (int k = 0; k < 5; ++k) {
      const std::array<double, 2> q{0.01 * k, -0.02 * k};
      const Step step = loop.torque(k, q);
      EXPECT_TRUE(step.ok());
      EXPECT_FALSE(step.restarted);
      torques.push_back(numbers(step.tau));
    }
    return torques;
  };
  const auto first = run();
  const std::array<double, 2> q{0, 0};
  const Step old = loop.torque(4, q);
  EXPECT_EQ(old.status, Status::old_tick);
  EXPECT_THAT(loop.reason(old), HasSubstr("call reset"));
  loop.reset();
  EXPECT_EQ(run(), first);
}

TEST(Loop, ReportsNumbersThatAreNotFiniteAndWrongSizes) {
  Loop loop(two_link);
  const std::array<double, 3> three{0, 0, 0};
  EXPECT_EQ(loop.torque(0, three).status, Status::wrong_size);
  const std::array<double, 2> good{0, 0}, bad{0, std::numeric_limits<double>::quiet_NaN()};
  const std::vector<double> first = numbers(loop.torque(0, good).tau);
  const Step step = loop.torque(1, bad);
  EXPECT_EQ(step.status, Status::not_finite);
  EXPECT_EQ(step.joint, 1);
  EXPECT_EQ(numbers(step.tau), first);  // the last one
  EXPECT_THAT(loop.reason(step), HasSubstr("position of joint 2 (elbow) at tick 1 is not finite"));
  EXPECT_TRUE(loop.torque(2, good).ok());
  Resting infinite;
  infinite.position = {0, std::numeric_limits<double>::infinity()};
  const Step beyond = loop.torque(3, good, infinite.view());
  EXPECT_EQ(beyond.status, Status::not_finite);
  EXPECT_THAT(loop.reason(beyond), HasSubstr("the reference or the torque of tick 3"));
  EXPECT_TRUE(loop.torque(3, good).ok());
}

TEST(Loop, GivesNothingUntilAResetAfterATorqueThatIsNotFinite) {
  Loop loop(two_link, {"controller.gains={kp: 1e300, kd: 1e300, a: 1000, b: 1000}"});
  const std::array<double, 2> good{0, 0}, far{1e10, 0};
  EXPECT_TRUE(loop.torque(0, good).ok());
  EXPECT_EQ(loop.torque(1, far).status, Status::not_finite);
  EXPECT_EQ(loop.torque(2, good).status, Status::not_finite);
  loop.reset();
  EXPECT_TRUE(loop.torque(0, good).ok());
}

TEST(Loop, LeavesOutWhatTheArmAddsItself) {
  Loop loop(two_link, {"robot.compensates.gravity=true"});
  const std::array<double, 2> q{0.4, -0.3};
  const Step step = loop.torque(0, q);
  const scenario::Scenario scenario = scenario::load_scenario(two_link);
  const Vector gravity = robot::gravity_torque(*scenario.model, Eigen::Vector2d(q.data()));
  EXPECT_GT(gravity.norm(), 1);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(step.tau[i], step.law_tau[i] - gravity[static_cast<Eigen::Index>(i)]);
  }
}

TEST(Loop, TakesAndGivesTheCoordinatesOfTheArm) {
  Loop plain(two_link);
  Loop turned(two_link, {"robot.joint_signs=[-1, 1]", "robot.joint_offsets_rad=[0.5, 0]"});
  const std::array<double, 2> q{0.4, -0.3}, reading{0.1, -0.3};  // 0.4 = -0.1 + 0.5
  const Step expected = plain.torque(0, q), got = turned.torque(0, reading);
  EXPECT_EQ(got.tau[0], -expected.tau[0]);
  EXPECT_EQ(got.tau[1], expected.tau[1]);
  EXPECT_EQ(numbers(got.law_tau), numbers(expected.law_tau));
}

TEST(Loop, GivesTheScenariosReference) {
  Loop loop(two_link);
  EXPECT_EQ(loop.planned(0).position[0], 0);
  EXPECT_NEAR(loop.planned(50).position[0], 0.03183098861837907, 1e-12);
  EXPECT_EQ(loop.planned(50).velocity.size(), 2U);
}

TEST(Loop, AllocatesNothingAfterItsConstructor) {
  CertifiedLoop loop(seven_joints, ReferenceBounds{{1}, {5}},
                     {"robot.compensates={gravity: true, coriolis: true}",
                      "plant.drive.torque_rate_limit_Nm_per_s=1000", "loop.duration_s=4"});
  Guards guards(loop);
  std::vector<double> q = seven_start;
  const std::vector<double> zero(7, 0.0);
  for (int run = 0; run < 2; ++run) {
    const std::size_t before = allocations;
    bool all = true;
    for (std::int64_t k = 0; k < 1000; ++k) {
      for (std::size_t i = 0; i < 7; ++i) q[i] = loop.planned(k).position[i] + 1e-5 * (k % 3);
      const Step step = k % 2 == 0 ? loop.torque(k, q) : loop.torque(k, q, loop.planned(k));
      all = all && step.ok() && guards.check(step).ok();
    }
    q[3] = std::numeric_limits<double>::infinity();
    all = all && guards.check(loop.torque(1000, q)).status == Status::not_finite;
    q[3] = 1e305;
    all = all && !guards.check(loop.torque(1001, q)).ok();
    loop.reset();
    guards.reset();
    EXPECT_TRUE(all);
    EXPECT_EQ(allocations, before);
  }
}

class GuardsTest : public testing::Test {
 protected:
  /// Returns the status of the first step that a guard stops, with its reason.
  std::pair<Status, std::string> end_of(const std::array<double, 2>& speed, const Words& set,
                                        const std::string& urdf_limit = "") {
    Loop loop(file(urdf_limit), set);
    Guards guards(loop);
    std::array<double, 2> q{0, 0};
    for (int k = 0; k < 200; ++k) {
      q = {speed[0] * k * 1e-3, speed[1] * k * 1e-3};
      const Step step = guards.check(loop.torque(k, q, {q, speed, std::array<double, 2>{0, 0}}));
      if (!step.ok()) return {step.status, guards.reason(step)};
    }
    return {Status::ok, ""};
  }
  std::string file(const std::string& urdf_limit) {
    std::string urdf = base::given_text(scenarios + "robots/two_link.urdf");
    const std::string elbow = R"(<joint name="elbow" type="continuous">)";
    urdf.replace(urdf.find(elbow), elbow.size(),
                 R"(<joint name="elbow" type="revolute"><limit effort="100" )" + urdf_limit + "/>");
    std::ofstream(directory_ / "arm.urdf") << urdf;
    std::string text = base::given_text(two_link);
    const std::string robot = "robots/two_link.urdf";
    text.replace(text.find(robot), robot.size(), "arm.urdf");
    std::ofstream(directory_ / "arm.yaml") << text;
    return (directory_ / "arm.yaml").string();
  }
  const std::string wide_ = R"(lower="-3" upper="3" velocity="10")";
  TemporaryDirectory directory_;
};

const Words limited = {"plant.drive.torque_limit_Nm=[300, 100]"};

TEST_F(GuardsTest, StopAJointOutsideOfItsRange) {
  const auto [status, reason] = end_of({0, 1}, limited, R"(lower="-1" upper="0.1" velocity="10")");
  EXPECT_EQ(status, Status::out_of_range);
  EXPECT_THAT(reason, HasSubstr("joint 2 (elbow) is at 0.101 rad at tick 101, outside of its range "
                                "-1 to 0.1 rad in arm.urdf"));
}

TEST_F(GuardsTest, StopAJointThatIsTooFast) {
  const auto [status, reason] = end_of({0, 2}, limited, R"(lower="-1" upper="1" velocity="1.5")");
  EXPECT_EQ(status, Status::too_fast);
  EXPECT_THAT(reason, HasSubstr("joint 2 (elbow) moves at 2 rad/s at tick 20"));
}

TEST_F(GuardsTest, HoldTheFirstStopUntilAReset) {
  Loop loop(file(wide_), {limited[0], "plant.following_error_rad=0.02"});
  Guards guards(loop);
  const std::array<double, 2> there{0, 0}, away{0, 0.0301};
  Resting far;
  far.position = {0, 0.01};
  EXPECT_TRUE(guards.check(loop.torque(0, there, far.view())).ok());  // the error at the start
  const std::vector<double> last = numbers(guards.check(loop.torque(1, there, far.view())).tau);
  far.position = {0, 0.0402};
  const Step off = guards.check(loop.torque(2, there, far.view()));
  EXPECT_EQ(off.status, Status::off_reference);
  EXPECT_EQ(numbers(off.tau), last);
  EXPECT_THAT(guards.reason(off), HasSubstr("joint 2 (elbow) is 0.0402 rad from its reference"));
  EXPECT_EQ(guards.check(loop.torque(3, away, far.view())).status, Status::off_reference);
  guards.reset();
  loop.reset();
  EXPECT_TRUE(guards.check(loop.torque(0, away, far.view())).ok());
}

TEST_F(GuardsTest, LimitTheTorqueAndItsRate) {
  Loop loop(file(wide_), {"plant.drive.torque_limit_Nm=[300, 50]",
                          "plant.drive.torque_rate_limit_Nm_per_s=[1e9, 10000]"});
  Guards guards(loop);
  const std::array<double, 2> q{0, 0};
  Resting reference;
  Step step = guards.check(loop.torque(0, q, reference.view()));
  EXPECT_FALSE(step.saturated);
  EXPECT_EQ(numbers(step.tau), numbers(step.law_tau));
  const double hold = step.tau[1];
  reference.position = {0, 0.04};  // 2400 N m/rad: 96 N m
  step = guards.check(loop.torque(1, q, reference.view()));
  EXPECT_TRUE(step.saturated);
  EXPECT_GT(step.law_tau[1], 50);
  EXPECT_DOUBLE_EQ(step.tau[1], hold + 10);
  for (int k = 2; k < 20; ++k) step = guards.check(loop.torque(k, q, reference.view()));
  EXPECT_EQ(step.tau[1], 50);
}

TEST_F(GuardsTest, NeedATorqueLimit) {
  const Loop loop(two_link);
  EXPECT_THROW(Guards{loop}, std::runtime_error);
}

TEST_F(GuardsTest, PassOnAStepThatIsNotOk) {
  Loop loop(file(wide_), limited);
  Guards guards(loop);
  const std::array<double, 2> q{0, 0};
  ASSERT_TRUE(guards.check(loop.torque(3, q)).ok());
  const Step step = guards.check(loop.torque(2, q));
  EXPECT_EQ(step.status, Status::old_tick);
  EXPECT_EQ(guards.reason(step), loop.reason(step));
}

}  // namespace
}  // namespace tachless::own_loop
