#pragma once

#include <string>

#include "linear/servo_loop.h"
#include "robot/dynamics.h"
#include "robot/mjcf.h"
#include "robot/mjcf_servos.h"

/// MuJoCo models with position actuators.
namespace tachless::linear::testing {

/// A joint that turns 0.3 kg m2 about the vertical.
inline const std::string one_joint = R"(<mujoco><worldbody><body>
  <joint name="turn" axis="0 0 1" damping="0" armature="0.1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.2 0.2 0.2"/></body></worldbody>
  <actuator><position joint="turn" kp="100"/></actuator></mujoco>)";

/// Four joints without armature, the last ones light. Without gravity a posture is at rest.
inline const std::string light_wrist = R"(<mujoco model="light_wrist">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0 0 0"/>
  <default>
    <joint range="-2.5 2.5"/>
    <general gaintype="fixed" biastype="affine" gainprm="400" biasprm="0 -400 -20"/>
  </default>
  <worldbody><body name="a">
    <joint name="a" axis="0 0 1"/>
    <inertial pos="0.02 0 0.1" mass="3" diaginertia="0.03 0.03 0.02"/>
    <body name="b" pos="0 0 0.2">
      <joint name="b" axis="0 1 0"/>
      <inertial pos="0 0.01 0.15" mass="2" diaginertia="0.02 0.02 0.004"/>
      <body name="c" pos="0 0 0.3">
        <joint name="c" axis="0 1 0"/>
        <inertial pos="0.01 0 0.1" mass="1" diaginertia="0.006 0.006 0.001"/>
        <body name="d" pos="0 0 0.2">
          <joint name="d" axis="1 0 0.5"/>
          <inertial pos="0.01 0.02 0.04" mass="0.3" diaginertia="0.0004 0.0004 0.0002"/>
        </body>
      </body>
    </body>
  </body></worldbody>
  <actuator>
    <general joint="a"/> <general joint="b"/> <general joint="c"/>
    <general joint="d" gainprm="100" biasprm="0 -100 -5"/>
  </actuator>
</mujoco>)";

/// Three joints with armature, damping and little kv: kp limits the implicit step.
inline const std::string stiff_arm = R"(<mujoco model="stiff_arm">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0 0 0"/>
  <default>
    <joint range="-2 2" armature="0.02" damping="0.4"/>
    <general gaintype="fixed" biastype="affine" gainprm="900" biasprm="0 -900 -3"/>
  </default>
  <worldbody><body name="a">
    <joint name="a" axis="0 1 0"/>
    <inertial pos="0 0 0.2" mass="2" diaginertia="0.03 0.03 0.002"/>
    <body name="b" pos="0 0 0.4">
      <joint name="b" axis="0 1 0"/>
      <inertial pos="0 0 0.15" mass="1" diaginertia="0.01 0.01 0.001"/>
      <body name="c" pos="0 0 0.3">
        <joint name="c" axis="1 0 0"/>
        <inertial pos="0 0 0.1" mass="0.5" diaginertia="0.002 0.002 0.0005"/>
      </body>
    </body>
  </body></worldbody>
  <actuator><general joint="a"/><general joint="b"/><general joint="c"/></actuator>
</mujoco>)";

/// A slide that carries a hinge, with a gear and a ratio between the units.
inline const std::string crane = R"(<mujoco model="crane">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0 0 0"/>
  <default>
    <general gaintype="fixed" biastype="affine" gainprm="2" biasprm="0 -2 -0.1"/>
  </default>
  <worldbody><body name="cart">
    <joint name="cart" type="slide" axis="1 0 0" range="-1 1" damping="2"/>
    <inertial pos="0 0 0" mass="4" diaginertia="0.1 0.1 0.1"/>
    <body name="boom">
      <joint name="boom" axis="0 1 0" range="-1 1" armature="0.01"/>
      <inertial pos="0 0 -0.4" mass="1" diaginertia="0.01 0.01 0.002"/>
    </body>
  </body></worldbody>
  <actuator><general joint="cart" gear="60"/><general joint="boom" gear="20"/></actuator>
</mujoco>)";

inline std::string no_file(const std::string& /*name*/) { return {}; }

inline robot::Model model_of(const std::string& text) {
  return robot::model_from_urdf(robot::description_of_mjcf(text, "arm.xml", no_file).urdf,
                                "arm.xml");
}

/// Returns the gains of a model whose actuators have the order of its joints.
inline ServoGains gains_of(const std::string& text) {
  const auto servos = robot::read_mjcf_servos(text, "arm.xml", no_file).servos;
  ServoGains gains{Vector::Zero(std::ssize(servos)), Vector::Zero(std::ssize(servos)), true};
  for (std::size_t i = 0; i < servos.size(); ++i) {
    gains.kp[static_cast<Eigen::Index>(i)] = servos[i].kp;
    gains.kv[static_cast<Eigen::Index>(i)] = servos[i].kv;
  }
  return gains;
}

}  // namespace tachless::linear::testing
