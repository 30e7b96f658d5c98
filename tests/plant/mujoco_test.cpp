// MuJoCo in the place of the emulator's mechanics, against these mechanics.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "certify/prediction.h"
#include "controller/registry.h"
#include "in_process/in_process_loop.h"
#include "plant/mujoco/mujoco.h"
#include "plant/plant_model.h"
#include "scenario/scenario.h"
#include "tests/support/temporary_directory.h"

namespace tachless::plant {
namespace {

using in_process::TickRecord;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// An arm of three joints with armature and damping; `more` is beside its bodies.
std::string arm(const std::string& more = "", const std::string& mass = "2") {
  return R"(<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001"/>
  <default><joint armature="0.05" damping="0.2"/></default>
  <worldbody>)" +
         more + R"(
    <body name="base" pos="0 0 0.6">
      <joint name="yaw" axis="0 0 1"/>
      <inertial pos="0 0 0.05" mass="1" diaginertia="0.01 0.01 0.01"/>
      <body name="upper" pos="0 0 0.1">
        <joint name="shoulder" axis="0 1 0"/>
        <inertial pos="0.01 0 0.15" mass=")" +
         mass + R"(" diaginertia="0.02 0.02 0.005"/>
        <body name="lower" pos="0 0 0.3">
          <joint name="elbow" axis="0 1 0"/>
          <inertial pos="0 0.01 0.1" mass="1" diaginertia="0.01 0.01 0.003"/>
          <geom name="tip" type="sphere" size="0.03" pos="0 0 0.25"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>)";
}

constexpr const char* scenario_text = R"(name: mujoco
robot: {name: arm, urdf: arm.xml, joints: rigid}
plant: {initial: {position_rad: [0, 0.3, 0.5], torque: hold}}
reference:
  point_to_point: {from_rad: [0, 0.3, 0.5], to_rad: [0.4, 0.6, 0.9], start_s: 0.05, duration_s: 0.4}
controller:
  law: loria_ortega_rigid
  gains: {kp: [200, 200, 80], kd: [20, 20, 8], a: [100, 100, 100], b: [100, 100, 100]}
  filter: tustin
  feedforward_lead: half_tick_plus_delay
loop: {mode: lockstep, period_s: 0.001, duration_s: 0.5, command_delay: 1}
)";

class MujocoPlant : public testing::Test {
 protected:
  MujocoPlant() {
    setenv("TACHLESS_MUJOCO", TACHLESS_BINARY_DIR "/lib/tachless/mujoco.so", 1);
    write("arm.xml", arm());
    write("arm.yaml", scenario_text);
  }
  void write(const char* name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
  }
  std::vector<TickRecord> records(const std::vector<std::string>& settings) const {
    std::vector<TickRecord> all;
    in_process::run_in_process(scenario::load_scenario(directory_ / "arm.yaml", settings),
                               [&](const TickRecord& record) {
                                 all.push_back(record);
                                 return true;
                               });
    return all;
  }
  std::string refusal(const std::vector<std::string>& settings) const {
    try {
      records(settings);
    } catch (const base::Failure& failure) {
      return failure.what();
    }
    return "accepted";
  }
  /// Returns the largest difference of positions from those of this library's mechanics.
  double error(const std::vector<std::string>& settings) const {
    const auto ours = records({"plant.mechanics=native", "plant.integrator.accuracy=1e-13"});
    std::vector<std::string> all = {"plant.mujoco.model=arm.xml"};
    all.insert(all.end(), settings.begin(), settings.end());
    const auto theirs = records(all);
    double worst = 0;
    for (std::size_t k = 0; k < ours.size(); ++k) {
      worst = std::max(worst, (ours[k].truth.q - theirs[k].truth.q).cwiseAbs().maxCoeff());
    }
    return worst;
  }

  TemporaryDirectory directory_;
};

TEST_F(MujocoPlant, ByRungeKuttaMovesAsTheEmulatorToTenDigits) {
  EXPECT_LT(error({"plant.mujoco.integrator=rk4"}), 1e-10);
}

TEST_F(MujocoPlant, ByEulerHasAnErrorThatHalvesWithTheStep) {
  const std::string euler = "plant.mujoco.integrator=euler";
  const double one = error({euler, "plant.mujoco.step_s=0.001"}),
               half = error({euler, "plant.mujoco.step_s=0.0005"});
  EXPECT_NEAR(one / half, 2, 0.02);
}

TEST_F(MujocoPlant, GivesTheSameBitsEachTime) {
  const std::vector<std::string> settings = {"plant.mujoco.model=arm.xml",
                                             "plant.encoder.noise_std_rad=1e-5"};
  const auto once = records(settings), again = records(settings);
  ASSERT_EQ(once.size(), 500U);
  for (std::size_t k = 0; k < once.size(); ++k) {
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(std::memcmp(&once[k].truth.q[i], &again[k].truth.q[i], sizeof(double)), 0) << k;
    }
  }
}

TEST_F(MujocoPlant, FeelsAWallThatIsInTheLog) {
  write("scene.xml", arm(R"(<geom name="wall" type="box" size="0.02 1 1" pos="0.4 0 1"/>)"));
  const auto free = records({"plant.mujoco.model=arm.xml"}),
             stopped = records({"plant.mujoco.model=scene.xml"});
  EXPECT_EQ(free.back().truth.disturbance.cwiseAbs().maxCoeff(), 0);
  double pushed = 0;
  for (const TickRecord& each : stopped) {
    pushed = std::max(pushed, each.truth.disturbance.cwiseAbs().maxCoeff());
  }
  EXPECT_GT(pushed, 1);
  EXPECT_GT((free.back().truth.q - stopped.back().truth.q).norm(), 0.01);
}

TEST_F(MujocoPlant, RefusesAnotherRobotWithItsNumbers) {
  write("heavy.xml", arm("", "2.2"));
  EXPECT_THAT(refusal({"plant.mujoco.model=heavy.xml"}),
              AllOf(HasSubstr("another robot than arm.xml"), HasSubstr("in the model"),
                    HasSubstr("plant.mujoco.may_differ")));
  EXPECT_EQ(refusal({"plant.mujoco.model=heavy.xml", "plant.mujoco.may_differ=true"}), "accepted");
}

TEST_F(MujocoPlant, RefusesWhatDoesNotFit) {
  write("other.xml",
        "<mujoco><worldbody><body><joint name='a'/><geom size='1'/></body></worldbody>"
        "</mujoco>");
  EXPECT_THAT(refusal({"plant.mujoco.model=other.xml"}), HasSubstr("no joint \"yaw\""));
  EXPECT_THAT(refusal({"plant.mujoco.model=none.xml"}), HasSubstr("none.xml"));
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml", "plant.mujoco.keyframe=home"}),
              HasSubstr("no keyframe \"home\""));
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml", "plant.payload.mass_kg=1"}),
              HasSubstr("a simulator has its own mechanics"));
  setenv("TACHLESS_MUJOCO", "/none/mujoco.so", 1);
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml"}), HasSubstr("no module for MuJoCo"));
}

/// Two links that hang on horizontal axes, without damping.
constexpr const char* two_links = R"(<mujoco model="two_links">
  <compiler angle="radian"/> <option timestep="0.001"/>
  <worldbody><body name="upper" pos="0 0 1">
    <joint name="shoulder" axis="0 1 0"/>
    <inertial pos="0.1 0 -0.2" mass="3" diaginertia="0.05 0.05 0.01"/>
    <body name="lower" pos="0 0 -0.4">
      <joint name="elbow" axis="0 1 0"/>
      <inertial pos="0 0 -0.15" mass="2" diaginertia="0.02 0.02 0.005"/>
    </body>
  </body></worldbody></mujoco>)";

/// An arm with the axes and about the sizes of a Panda, armature 0.1 and damping 1.
std::string seven_joints() {
  std::string bodies, ends;
  const std::vector<std::string> axes{"0 0 1", "0 1 0",  "0 0 1", "0 -1 0",
                                      "0 0 1", "0 -1 0", "0 0 -1"};
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const double mass = 4 - 0.5 * static_cast<double>(i);
    bodies += fmt::format(
        R"(<body name="link{0}" pos="{1} 0 {2}"><joint name="joint{0}" axis="{3}"/>
        <inertial pos="0.02 0.01 0.06" mass="{4}" diaginertia="{5} {6} {7}"/>)",
        i + 1, i == 3 ? 0.08 : 0, i == 0 ? 0.33 : 0.16, axes[i], mass, 0.008 * mass, 0.007 * mass,
        0.004 * mass);
    ends += "</body>";
  }
  return R"(<mujoco model="seven"><compiler angle="radian"/><option timestep="0.001"/>
    <default><joint armature="0.1" damping="1"/></default><worldbody>)" +
         bodies + ends + "</worldbody></mujoco>";
}

TEST_F(MujocoPlant, SticksByTheSolverParametersOfThePage) {
  // Gravity pulls with 9 N m against 40 N m of dry friction.
  const auto creep = [&](const std::string& parameters) {
    std::string model = two_links;
    model.insert(model.find("<worldbody>"),
                 "<default><joint frictionloss=\"40\" " + parameters + "/></default>");
    write("arm.xml", model);
    const auto scenario = scenario::load_scenario(
        directory_ / "arm.yaml",
        {"plant.mujoco={model: arm.xml, integrator: rk4}", "plant.initial={}",
         "controller.gains={kp: 100, kd: 10, a: 100, b: 100}",
         "reference={hold: {position_rad: [0, 0]}}"});
    const auto simulator = mujoco_simulator(scenario, plant_model(scenario));
    const Vector start = Eigen::Vector2d(0.7, -0.4);
    simulator->reset({start, Vector::Zero(2), {}, {}});
    for (int k = 1; k <= 2000; ++k) simulator->advance(Vector::Zero(2), 0.001 * k);
    return (simulator->state().q - start).cwiseAbs().maxCoeff();
  };
  EXPECT_GT(creep(""), 1e-4);
  EXPECT_LT(creep(R"(solreffriction=".002 1" solimpfriction=".9999 .9999 .001")"), 1e-5);
}

/// The largest deviation from the reference in the last twentieth of a run at this part of the
/// limit of the certificate, over the deviation at the start.
double growth(const std::filesystem::path& file, double part) {
  constexpr double apart = 1e-6;
  constexpr int ticks = 8000;
  scenario::Scenario scenario =
      scenario::load_scenario(file, {"plant.mujoco={model: arm.xml, integrator: rk4}",
                                     "plant.initial={torque: hold}", "plant.on_limit=warn"});
  const auto& hold = std::get<reference::trajectory::Hold>(scenario.reference);
  const auto limit_s = certify::analyse(scenario, linear::Effort::quick).limit_s;
  scenario.loop.period_s = part * limit_s.value();
  scenario.loop.num_ticks = ticks;
  scenario.loop.duration_s = ticks * scenario.loop.period_s;
  scenario.plant.initial.position_rad =
      hold.position_rad + Vector::Constant(scenario.num_joints, apart);
  double last = 0;
  try {
    in_process::run_in_process(scenario, [&](const TickRecord& record) {
      if (record.tick >= ticks - ticks / 20) {
        last = std::max(last, (record.truth.q - hold.position_rad).cwiseAbs().maxCoeff());
      }
      return true;
    });
  } catch (const base::Failure&) {
    return infinity;
  }
  return last / apart;
}

TEST_F(MujocoPlant, BehavesAsTheCertificatesLimitSays) {
  for (const std::string& model : {std::string(two_links), arm(), seven_joints()}) {
    write("arm.xml", model);
    const auto n = model == two_links ? 2 : model == arm() ? 3 : 7;
    std::string text = "name: limit\nrobot: {name: arm, urdf: arm.xml, joints: rigid}\n";
    std::vector<double> q, kp, kd;
    for (int i = 0; i < n; ++i) {
      q.push_back(0.3 + 0.1 * i);
      kp.push_back(300.0 / (1 + i));
      kd.push_back(30.0 / (1 + i));
    }
    text += fmt::format(
        "reference: {{hold: {{position_rad: [{}]}}}}\n"
        "controller:\n  law: loria_ortega_rigid\n"
        "  gains: {{kp: [{}], kd: [{}], a: 200, b: 200}}\n  filter: tustin\n"
        "loop: {{mode: lockstep, period_s: 0.001, duration_s: 1, command_delay: 1}}\n",
        fmt::join(q, ", "), fmt::join(kp, ", "), fmt::join(kd, ", "));
    write("limit.yaml", text);
    EXPECT_LT(growth(directory_ / "limit.yaml", 0.98), 0.5) << model;
    EXPECT_GT(growth(directory_ / "limit.yaml", 1.02), 100) << model;
  }
}

TEST_F(MujocoPlant, ThatStartsAgainIsTheModelOfItsDigest) {
  const auto model = [&](const std::string& given) {
    return scenario::load_scenario(directory_ / "arm.yaml", {"plant.mujoco.model=" + given})
        .plant.mujoco.model;
  };
  const std::string pinned = model("arm.xml");
  EXPECT_THAT(pinned, ::testing::MatchesRegex("arm\\.xml@[0-9a-f]{16}"));
  EXPECT_EQ(model(pinned), pinned);
  EXPECT_EQ(refusal({"plant.mujoco.model=" + pinned}), "accepted");
  write("arm.xml", arm("", "2.5"));
  EXPECT_THAT(refusal({"plant.mujoco.model=" + pinned}),
              AllOf(HasSubstr("the file is another model, arm.xml@"), HasSubstr("or arm.xml")));
  // Included files count too.
  write("all.xml", "<mujoco><include file=\"arm.xml\"/></mujoco>");
  const std::string all = model("all.xml");
  write("arm.xml", arm());
  EXPECT_NE(model("all.xml"), all);
  // An include in a comment is none.
  write("all.xml", "<mujoco><!-- <include file=\"gone.xml\"/> --></mujoco>");
  EXPECT_THAT(model("all.xml"), ::testing::MatchesRegex("all\\.xml@[0-9a-f]{16}"));
}

TEST_F(MujocoPlant, ThatRunsAwayEndsTheRun) {
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml", "controller.gains.kp=1e9",
                       "controller.gains.kd=1e7", "plant.on_limit=warn"}),
              HasSubstr("at tick"));
}

}  // namespace
}  // namespace tachless::plant
