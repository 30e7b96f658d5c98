// An arm adds gravity by itself and turns the other way. A scenario that tells this gives the
// emulator's loop. Any other scenario ends in a protective stop before the arm has moved far.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "base/failure.h"
#include "controller/registry.h"
#include "plant/guarded_robot.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "tests/support/temporary_directory.h"

namespace tachless::plant {
namespace {

using testing::AllOf;
using testing::HasSubstr;

scenario::Scenario scenario_of_arm(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(),
                   {"plant.encoder.resolution_bits=null", "plant.drive.torque_limit_Nm=[400, 400]",
                    "plant.initial.torque=hold", "plant.initial.position_rad=[0.3, -0.2]",
                    "reference={hold: {position_rad: [0.3, -0.2]}}", "loop.duration_s=2",
                    "controller.gains.kp=[200, 50]", "controller.gains.kd=[100, 20]",
                    "controller.gains.a=[50, 50]", "controller.gains.b=[50, 50]"});
  return scenario::load_scenario(
      std::string(TACHLESS_SOURCE_DIR) + "/scenarios/practical_rigid.yaml", overrides);
}

/// The two-link arm of a maker whose controller adds gravity, with an elbow that counts from
/// elsewhere and turns the other way.
class MakersArm final : public RobotDriver {
 public:
  explicit MakersArm(const scenario::Scenario& s)
      : model_(plant_model(s)), robot_(s.plant, s.robot.flexible, s.loop.period_s, model_) {}
  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override { robot_.start(); }
  ArmState read() override {
    ArmState state = robot_.read();
    q_ = state.q;
    moved = std::max(moved, (q_ - first_).cwiseAbs().maxCoeff());
    state.q[1] = zero - state.q[1];
    state.v[1] = -state.v[1];
    return state;
  }
  void hold(const Vector& tau, double until_s) override {
    Vector sum = tau;
    sum[1] = -sum[1];
    sum += robot::gravity_torque(model_, q_);
    robot_.hold(sum, until_s);
  }
  void stop() override { robot_.stop(); }

  static constexpr double zero = 1.25;
  double moved = 0;  ///< largest distance from its start [rad]

 private:
  robot::Model model_;
  EmulatedRobot robot_;
  Vector first_ = robot_.read().q, q_ = first_;
};

/// Returns the position at the end of the loop, with a driver or in emulation.
Vector end_of_run(const scenario::Scenario& scenario, RobotDriver* driver) {
  const controller::ScenarioLaw law = controller::scenario_law(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  GuardedRobot robot(scenario, driver);
  robot.feed(law->measurement());
  robot.start();
  for (std::int64_t k = 0; k < scenario.loop.num_ticks; ++k) {
    robot.read(k);
    const double time_s = static_cast<double>(k) * scenario.loop.period_s;
    robot.accept(law->step(k, robot.measure(k), trajectory.at(time_s)).command);
    robot.advance(k);
    robot.end_tick();
  }
  return robot.state().q;
}

const std::vector<std::string> elbow = {"robot.joint_signs=[1, -1]",
                                        "robot.joint_offsets_rad=[0, 1.25]"};

std::vector<std::string> and_also(std::vector<std::string> settings, std::string one) {
  settings.push_back(std::move(one));
  return settings;
}

TEST(ArmConventions, MakeAnArmThatAddsGravityTheLoopOfTheEmulator) {
  // The arm begins away from its reference, so that it moves.
  const std::string away = "plant.initial.position_rad=[0.25, -0.1]";
  const auto told =
      scenario_of_arm(and_also(and_also(elbow, "robot.compensates.gravity=true"), away));
  MakersArm arm(told);
  const Vector q = end_of_run(told, &arm);
  EXPECT_GT(arm.moved, 0.01);
  // The plant takes g away one tick after the law's own g. The error is 40 N m/rad times the 1e-3
  // rad or so of a tick's motion. The law's 100 N m/rad act against it.
  const Vector emulated = end_of_run(scenario_of_arm({away}), nullptr);
  EXPECT_LT((q - emulated).norm(), 2e-3) << q << "\n" << emulated;
}

TEST(ArmConventions, NotToldOfDoubleGravityAndStopTheArmWithinAFewHundredthsOfARadian) {
  const auto trap = scenario_of_arm(elbow);
  MakersArm arm(trap);
  try {
    end_of_run(trap, &arm);
    FAIL() << "gravity twice goes unnoticed";
  } catch (const base::Failure& stop) {
    EXPECT_EQ(stop.code(), base::ExitCode::protective_stop);
    EXPECT_THAT(stop.what(), AllOf(HasSubstr("from its reference at tick"),
                                   HasSubstr("plant.following_error_rad: 0.05"),
                                   HasSubstr("robot.compensates")));
  }
  // The bound is the limit and the way of one tick.
  EXPECT_LT(arm.moved, 0.055);
}

TEST(ArmConventions, NotToldOfAnotherZeroRefuseToStart) {
  const auto elsewhere = scenario_of_arm({"robot.compensates.gravity=true"});
  MakersArm arm(elsewhere);
  try {
    end_of_run(elsewhere, &arm);
    FAIL() << "it is not where the scenario begins";
  } catch (const base::Failure& refused) {
    EXPECT_THAT(refused.what(), HasSubstr("joint 2 (elbow), which is at 1.45"));
  }
}

TEST(ArmConventions, AnArmThatCompensatesFrictionHasTheRestOfIt) {
  std::ifstream file(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf");
  std::string urdf(std::istreambuf_iterator<char>(file), {});
  const std::string joint = "</joint>";
  for (std::size_t at = 0; (at = urdf.find(joint, at)) != std::string::npos;) {
    const std::string dynamics = R"(<dynamics damping="0.5" friction="1"/>)";
    urdf.insert(at, dynamics);
    at += dynamics.size() + joint.size();
  }
  const TemporaryDirectory directory;
  std::ofstream(directory.path() / "arm.urdf") << urdf;
  const auto with = [&](const std::string& friction) {
    return scenario_of_arm({"robot.urdf=" + (directory.path() / "arm.urdf").string(),
                            "robot.compensates.friction=" + friction});
  };
  const double whole = with("0").plant.drive.coulomb_friction_Nm.maxCoeff();
  EXPECT_GT(whole, 0);
  EXPECT_EQ(with("0.75").plant.drive.coulomb_friction_Nm.maxCoeff(), 0.25 * whole);
  EXPECT_EQ(with("1").plant.drive.coulomb_friction_Nm.maxCoeff(), 0);
  EXPECT_EQ(with("1").plant.drive.viscous_friction_Nms_per_rad.maxCoeff(), 0);
}

}  // namespace
}  // namespace tachless::plant
