#pragma once

/// MuJoCo models of our own that several tests read. Each uses only what MuJoCo 2.2.2 knows.
namespace tachless::robot::testing {

/// Nested classes, all forms of orientation, degrees, two joints in one body beside its origin, a
/// slide, a position of reference, and a fixed body with mass.
inline constexpr const char* nested_model = R"(<mujoco model="nested">
  <compiler angle="degree" eulerseq="XYz" autolimits="true"/>
  <default>
    <joint damping="0.5"/>
    <default class="arm">
      <joint axis="0 1 0" armature="0.02" range="-90 90"/>
      <motor ctrlrange="-2 2" gear="30"/>
      <default class="wrist">
        <joint armature="0.003" frictionloss="0.1"/>
      </default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 0.1"/>
    <body name="stand" pos="0.1 0 0.5" euler="10 20 30" childclass="arm">
      <body name="upper" pos="0 0.05 0.1" axisangle="1 2 0 25">
        <joint name="yaw" axis="0 0 1" pos="0.02 0 0.01"/>
        <joint name="pitch" pos="0 0 0.03" ref="15" range="-80 100"/>
        <inertial pos="0.01 0.02 0.15" mass="2.5" diaginertia="0.03 0.02 0.01"
                  quat="0.9 0.1 -0.2 0.3"/>
        <body name="slider" pos="0.02 0 0.3" xyaxes="1 0.1 0 0 1 0.2">
          <joint name="lift" type="slide" axis="1 0 2" range="-0.1 0.4" ref="0.05"/>
          <inertial pos="0 0 0.05" mass="1.2" diaginertia="0.004 0.005 0.006" euler="0 40 0"/>
          <body name="box" pos="0.1 0 0">
            <inertial pos="0.02 0 0" mass="0.4" diaginertia="0.001 0.001 0.001"/>
          </body>
          <body name="hand" pos="0 0 0.2" zaxis="0.3 -0.2 0.9">
            <joint name="roll" class="wrist" axis="1 0 1" pos="0 0 -0.02" range="-170 170"/>
            <inertial pos="0.01 0 0.04" mass="0.7" diaginertia="0.002 0.0015 0.001"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="yaw" joint="yaw" class="arm"/>
    <motor name="pitch" joint="pitch" class="arm" gear="20"/>
    <position name="roll" joint="roll" kp="10" forcerange="-5 5" gear="2"/>
  </actuator>
</mujoco>)";

/// Bodies whose mass comes from one primitive geom each.
inline constexpr const char* primitive_model = R"(<mujoco model="primitives">
  <compiler angle="radian" inertiagrouprange="0 2"/>
  <default>
    <geom density="700"/>
    <default class="heavy"><geom density="2700" rgba="1 0 0 1"/></default>
  </default>
  <worldbody>
    <body name="base">
      <geom type="cylinder" size="0.1 0.05"/>
      <body name="one" pos="0 0 0.1">
        <joint name="j1" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0.1 0.2" size="0.04"/>
        <geom type="box" size="1 1 1" group="3"/>
        <body name="two" pos="0.3 0.1 0.2">
          <joint name="j2" axis="0 1 0"/>
          <geom class="heavy" type="box" size="0.1 0.05 0.02" pos="0.1 0 0" euler="0.1 0.2 0.3"/>
          <body name="three" pos="0.2 0 0">
            <joint name="j3" axis="0 1 0.2"/>
            <geom type="ellipsoid" size="0.1 0.05 0.03" mass="1.5" pos="0.05 0 0.01"/>
            <body name="four" pos="0.15 0 0">
              <joint name="j4" axis="1 0 0"/>
              <geom type="cylinder" size="0.03 0.08" zaxis="1 1 0"/>
              <body name="five" pos="0.1 0 0">
                <joint name="j5" axis="0 1 0"/>
                <geom type="sphere" size="0.05" pos="0.02 0.03 0"/>
                <geom type="sphere" size="0.05" mass="0"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>)";

/// Fingers that follow another joint, one of them with a position of reference.
inline constexpr const char* gripper_model = R"(<mujoco model="gripper">
  <compiler angle="radian"/>
  <worldbody>
    <body name="table" pos="1 0 0"><geom type="box" size="0.2 0.2 0.2"/></body>
    <body name="arm" pos="0 0 0.3">
      <joint name="elbow" axis="0 1 0"/>
      <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>
      <body name="left" pos="0.2 0 0">
        <joint name="left" type="slide" axis="0 1 0" armature="0.1"/>
        <inertial pos="0.01 0.02 0" mass="0.1" diaginertia="1e-4 2e-4 2e-4"/>
      </body>
      <body name="right" pos="0.2 0 0">
        <joint name="right" type="slide" axis="0 -1 0" armature="0.1"/>
        <inertial pos="0.01 -0.02 0" mass="0.1" diaginertia="1e-4 2e-4 2e-4"/>
      </body>
      <body name="cam" pos="0.1 0 0.1">
        <joint name="cam" axis="0 1 0" ref="0.2"/>
        <inertial pos="0.03 0 0" mass="0.2" diaginertia="1e-4 2e-4 2e-4"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="right" joint2="left"/>
    <joint joint1="cam" joint2="left" polycoef="0.1 -3 0 0 0"/>
  </equality>
</mujoco>)";

/// Inertials that <compiler> bounds from below, or balances.
inline constexpr const char* corrected_model = R"(<mujoco model="corrected">
  <compiler angle="radian" boundmass="0.5" boundinertia="0.001" balanceinertia="true"/>
  <worldbody>
    <body name="one">
      <joint name="j1" axis="0 0 1"/>
      <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.05"/>
      <body name="two" pos="0.2 0 0">
        <joint name="j2" axis="0 1 0"/>
        <inertial pos="0.1 0 0" mass="0.1" diaginertia="0.0001 0.002 0.002"/>
      </body>
    </body>
  </worldbody>
</mujoco>)";

/// An inertial with products of inertia, and a body of several geoms.
inline constexpr const char* full_model = R"(<mujoco model="full">
  <compiler angle="radian"/>
  <worldbody>
    <body name="one">
      <joint name="j1" axis="0 0 1"/>
      <inertial pos="0.1 0 0" mass="2" fullinertia="0.03 0.04 0.05 0.001 -0.002 0.003"/>
      <body name="two" pos="0.2 0 0">
        <joint name="j2" axis="0 1 0"/>
        <geom type="box" size="0.1 0.05 0.02" pos="0.1 0 0" euler="0.1 0.2 0.3"/>
        <geom type="capsule" size="0.03 0.1" pos="0.2 0 0.1"/>
      </body>
    </body>
  </worldbody>
</mujoco>)";

}  // namespace tachless::robot::testing
