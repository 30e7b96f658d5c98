#include "plant/mujoco/mujoco.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <stdexcept>

#include "base/logging.h"
#include "base/text.h"
#include "base/this_process.h"
#include "plant/mujoco/interface.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"
#include "scenario/model_pin.h"

namespace tachless::plant {
namespace {

namespace fs = std::filesystem;

constexpr const char* key = "plant.mujoco.model";

/// Returns the place of the module: beside the programs, or that of TACHLESS_MUJOCO.
fs::path module_file() {
  const char* const given = std::getenv("TACHLESS_MUJOCO");
  return given != nullptr ? fs::path(given)
                          : base::program_directory().parent_path() / "lib/tachless/mujoco.so";
}

/// Opens the module and returns its function; null without them.
MakeMujocoSimulator* module_function() {
  void* const module = dlopen(module_file().c_str(), RTLD_NOW | RTLD_LOCAL);
  void* const function = module == nullptr ? nullptr : dlsym(module, mujoco_function);
  return reinterpret_cast<MakeMujocoSimulator*>(function);
}

/// @throw base::Failure(bad_usage) without the module
MakeMujocoSimulator* required_function(const scenario::Scenario& scenario) {
  if (MakeMujocoSimulator* const function = module_function()) return function;
  const char* const why = dlerror();
  throw scenario.complaint(
      key,
      "no module for MuJoCo ({}); install the package tachless-mujoco, or build tachless where "
      "libmujoco-dev is installed, or name the module in TACHLESS_MUJOCO",
      why == nullptr ? module_file().string() : base::one_line(why));
}

MujocoRequest request_of(const scenario::Scenario& scenario, const robot::Model& model) {
  const MujocoSpec& spec = scenario.plant.mujoco;
  MujocoRequest request;
  request.model =
      (fs::path(scenario.source).parent_path() / scenario::without_digest(spec.model)).string();
  request.keyframe = spec.keyframe;
  request.integrator = spec.integrator;
  request.step_s = spec.step_s;
  request.num_joints = model.num_joints;
  for (const robot::Body& body : model.bodies) {
    const std::string& own = model.joint_names[static_cast<std::size_t>(body.coordinate)];
    request.joints.push_back(
        {body.joint, body.coordinate, body.multiplier, body.offset, body.joint == own});
  }
  return request;
}

/// Returns where the mechanics of the two differ most, beyond rounding and the accuracy of MuJoCo's
/// principal moments; empty if they do not.
std::string difference(MujocoSimulator& simulator, const robot::Model& model, const Vector& start) {
  constexpr double tolerance = 1e-6;
  constexpr int postures = 11;
  const robot::JointLabels labels = robot::joint_labels(model);
  std::mt19937 random(1);
  Vector q = start;
  double worst = tolerance;
  std::string text;
  for (int k = 0; k < postures; ++k) {
    Matrix M, M_mujoco;
    Vector gravity, gravity_mujoco;
    robot::set_equations_of_motion(model, q, Vector::Zero(model.num_joints), M, gravity);
    simulator.evaluate(q, M_mujoco, gravity_mujoco);
    const double heaviest = std::max(gravity.cwiseAbs().maxCoeff(), 1e-3 * M.diagonal().maxCoeff());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const std::string joint = labels.joint(static_cast<std::size_t>(i));
      const auto note = [&](const char* what, double ours, double theirs, double scale) {
        if (std::abs(ours - theirs) / scale <= worst) return;
        worst = std::abs(ours - theirs) / scale;
        text = fmt::format("{} of {} is {:.6g}, in the model {:.6g}", what, joint, ours, theirs);
      };
      note("the inertia", M(i, i), M_mujoco(i, i), M(i, i));
      note("the gravity torque", gravity[i], gravity_mujoco[i], heaviest);
    }
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const auto [low, high] = robot::finite_range(model, static_cast<int>(i));
      q[i] = low + (high - low) * (random() / 4294967296.0);
    }
  }
  return text;
}

}  // namespace

bool has_mujoco_module() { return module_function() != nullptr; }

std::unique_ptr<Simulator> mujoco_simulator(const scenario::Scenario& scenario,
                                            const robot::Model& model) {
  MakeMujocoSimulator* const make = required_function(scenario);
  const MujocoRequest request = request_of(scenario, model);
  const ArmState start = initial_state(scenario.plant, scenario.robot.flexible, model);
  try {
    std::unique_ptr<MujocoSimulator> simulator(make(request));
    const std::string differs = difference(*simulator, model, start.q);
    if (!differs.empty() && !scenario.plant.mujoco.may_differ) {
      throw scenario.complaint(key,
                               "{}: it is another robot than {}: {}; correct one of the two, or "
                               "give plant.mujoco.may_differ: true",
                               request.model, scenario.robot.urdf_path, differs);
    }
    base::log_detail("mechanics: {}, {}", simulator->version(), request.model);
    return simulator;
  } catch (const base::Failure&) {
    throw;
  } catch (const std::runtime_error& problem) {
    throw scenario.complaint(key, "{}: {}", request.model, base::one_line(problem.what()));
  }
}

}  // namespace tachless::plant
