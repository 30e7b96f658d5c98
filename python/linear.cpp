#include <fmt/format.h>
#include <pybind11/eigen.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <string>
#include <vector>

#include "controller/registry.h"
#include "linear/scenario_loop.h"
#include "python/python_law.h"
#include "scenario/scenario.h"

namespace tachless::python {
namespace {

using Names = std::vector<std::string>;
using py::literals::operator""_a;

/// Adds "what joint [unit]" for each joint to `names`.
void add(Names& names, const std::string& what, const Names& joints, const Names& units,
         const char* per = "") {
  for (std::size_t i = 0; i < joints.size(); ++i) {
    names.push_back(fmt::format("{} {} [{}{}]", what, joints[i], units[i], per));
  }
}

/// Names the `size` entries of the state of `linear::CutLoop`.
Names states_of(const scenario::Scenario& scenario, Eigen::Index size, int delay) {
  const auto [joints, length, effort] = robot::joint_labels(*scenario.model);
  Names names;
  add(names, "q", joints, length);
  add(names, "v", joints, length, "/s");
  if (scenario.robot.flexible) {
    add(names, "theta", joints, length);
    add(names, "thetadot", joints, length, "/s");
  }
  if (scenario.plant.drive.current_loop_hz)
    add(names, "torque of the current loop", joints, effort);
  const auto memory_end = static_cast<std::size_t>(size - delay * scenario.num_joints);
  for (int i = 1; names.size() < memory_end; ++i) names.push_back(fmt::format("memory {}", i));
  for (int k = 1; k <= delay; ++k) add(names, fmt::format("tau[k-{}]", k), joints, effort);
  return names;
}

py::dict linear(const std::filesystem::path& path, const Names& overrides,
                const py::object& posture, bool open) {
  const scenario::Scenario scenario = scenario::load_scenario(path, overrides);
  const linear::ScenarioLoop loop(scenario);
  const auto& law = controller::law_facts(scenario.controller.law);
  if (!law.no_linearisation.empty()) {
    throw scenario.complaint("controller.law", fmt::format("{} cannot be linearised ({})", law.name,
                                                           law.no_linearisation));
  }
  const int n = scenario.num_joints;
  const Vector q = posture.is_none() ? loop.rest_at(0).q_ref : vector_of(posture, n, "posture");
  if (!q.allFinite()) throw base::bad_usage("posture: not finite; give finite numbers");
  const double h = scenario.loop.period_s;
  const auto& [A, B, C] = linear::cut(loop.at(linear::constant_reference(q)), h);
  const Eigen::MatrixXd positions = Eigen::MatrixXd::Identity(n, A.rows());
  const auto [joints, length, effort] = robot::joint_labels(*scenario.model);
  Names inputs, outputs;
  add(inputs, "tau", joints, effort);
  add(outputs, open ? "-tau" : "q", joints, open ? effort : length);
  return py::dict("A"_a = open ? A : A + B * C, "B"_a = B, "C"_a = open ? -C : positions,
                  "D"_a = Eigen::MatrixXd(Eigen::MatrixXd::Zero(n, n)), "h"_a = h,
                  "posture"_a = array_of(q),
                  "states"_a = states_of(scenario, A.rows(), loop.settings().command_delay),
                  "inputs"_a = inputs, "outputs"_a = outputs);
}

}  // namespace

void declare_linear(py::module_& module) { module.def("linear", &linear); }

}  // namespace tachless::python
