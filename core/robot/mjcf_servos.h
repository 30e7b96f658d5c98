#pragma once

#include <map>
#include <string>
#include <vector>

#include "robot/mjcf.h"

namespace tachless::robot {

/// Position or velocity actuator of a MuJoCo model. At its joint the actuator adds the torque -kp q
/// - kv v, and a torque that depends on its control input.
struct MjcfServo {
  std::string name;  ///< name of the actuator; empty: it has none
  std::string joint;
  double kp = 0;             ///< [N m/rad; N/m]
  double kv = 0;             ///< [N m s/rad; N s/m]; 0 where `damping_ratio` replaces it
  double damping_ratio = 0;  ///< kv over 2 sqrt(kp M_jj) at `reference`, or 0
};

/// The position and velocity actuators of a MuJoCo model, and how its steps are computed.
struct MjcfServos {
  std::string integrator = "Euler";  ///< Euler, RK4, implicit or implicitfast
  double step_s = 0.002;
  bool implicit_joint_damping = true;  ///< Euler's method takes joint damping at the step's end
  std::vector<MjcfServo> servos;
  std::map<std::string, double> reference;  ///< positions of named joints in qpos0 [rad; m]
  std::vector<std::string> warnings;        ///< actuators that are left out, each with its source
};

/// Reads the actuators and options of a MuJoCo model. Gains include the gear. `<position>`,
/// `<intvelocity>`, `<velocity>` and `<general>` with constant gain and affine bias are read.
/// `<motor>` has no gains.
/// @param source name of the file, for messages
/// @throw std::invalid_argument, one line, as `read_mjcf_joints`, and for an unknown integrator, a
/// step that is not above 0, or gains below 0
MjcfServos read_mjcf_servos(const std::string& text, const std::string& source,
                            const IncludedText& included);

}  // namespace tachless::robot
