#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "in_process/in_process_loop.h"
#include "plant/mujoco/mujoco.h"
#include "plant/plant_model.h"
#include "scenario/scenario.h"
#include "tests/support/temporary_directory.h"

/// MuJoCo models of arms, and a loop with MuJoCo in the emulator's place.
namespace tachless::plant {

using in_process::TickRecord;

/// Two links that hang on horizontal axes, without damping.
inline constexpr const char* two_links = R"(<mujoco model="two_links">
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
inline std::string seven_joints() {
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

/// An arm of three joints with armature and damping; `more` is beside its bodies.
inline std::string arm(const std::string& more = "", const std::string& mass = "2",
                       const std::string& drives = R"(armature="0.05" damping="0.2")") {
  return R"(<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001"/>
  <default><joint )" +
         drives + R"(/></default>
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

inline constexpr const char* scenario_text = R"(name: mujoco
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

/// Returns a scenario of an arm that begins at `start`, for torques that a test gives.
inline std::string open_loop_text(const Vector& start) {
  const std::vector<double> q(start.begin(), start.end());
  return fmt::format(
      "name: open\nrobot: {{name: arm, urdf: arm.xml, joints: rigid}}\n"
      "plant: {{initial: {{position_rad: [{0}]}}}}\n"
      "reference: {{hold: {{position_rad: [{0}]}}}}\n"
      "controller:\n  law: loria_ortega_rigid\n  gains: {{kp: 100, kd: 10, a: 100, b: 100}}\n"
      "  filter: tustin\n"
      "loop: {{mode: lockstep, period_s: 0.001, duration_s: 1, command_delay: 1}}\n",
      fmt::join(q, ", "));
}

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

}  // namespace tachless::plant
