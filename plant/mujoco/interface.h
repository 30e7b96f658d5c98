#pragma once

#include <string>
#include <vector>

#include "base/quantities.h"
#include "plant/simulator.h"
#include "plant/spec.h"

/// The interface between the programs and the module that links MuJoCo.
namespace tachless::plant {

/// A joint of the MuJoCo model that moves with a coordinate of the scenario: multiplier q + offset.
struct MujocoJoint {
  std::string name;
  int coordinate = 0;
  double multiplier = 1, offset = 0;
  bool driven = false;  ///< the coordinate's own joint, on which the torque acts
};

/// Request for a simulator from the module.
struct MujocoRequest {
  std::string model;  ///< file
  std::string keyframe;
  MujocoIntegrator integrator = MujocoIntegrator::model;
  double step_s = 0;
  int num_joints = 0;
  std::vector<MujocoJoint> joints;
};

/// MuJoCo's mechanics, as the module makes them.
class MujocoSimulator : public Simulator {
 public:
  /// Computes the inertia matrix and gravity torque of the joints at `q`. `reset` has to follow.
  virtual void evaluate(const Vector& q, Matrix& M, Vector& gravity) = 0;
  /// Returns "MuJoCo 2.2.2".
  [[nodiscard]] virtual std::string version() const = 0;
};

/// The module's function. It throws std::runtime_error for a model that does not fit.
using MakeMujocoSimulator = MujocoSimulator*(const MujocoRequest&);
inline constexpr const char* mujoco_function =
    "tachless_mujoco_2";  ///< changes with the types above

}  // namespace tachless::plant
