#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

#include "bench/bare_simbody.h"
#include "plant/arm.h"
#include "robot/dynamics.h"

using namespace tachless;

/// A tick of 50 us with the torque jumping every tick, by the plant and by bare Simbody.
namespace {

robot::Model model(int joints) {
  const std::string path = std::string(TACHLESS_SOURCE_DIR) + "/scenarios/robots/" +
                           (joints == 2 ? "two_link" : "iiwa7") + ".urdf";
  std::ifstream in(path);
  if (!in) throw std::runtime_error("cannot read " + path);
  std::ostringstream text;
  text << in.rdbuf();
  return robot::model_from_urdf(text.str(), path);
}

plant::ArmState start(int joints) {
  plant::ArmState state;
  state.q = robot::Vector::Constant(joints, 0.3);
  state.v = robot::Vector::Constant(joints, 0.5);
  return state;
}

/// Two links of a metre, or the seven joints of an iiwa: robots without mimic joints, which bare
/// Simbody can have too.
robot::Model tree(int joints) {
  if (joints == 7) return model(7);
  const auto link = [](int i, double at) {
    return fmt::format(
        R"(<joint name="j{0}" type="continuous"><parent link="l{1}"/><child link="l{0}"/>
           <origin xyz="{2} 0 0"/><axis xyz="0 1 0"/></joint><link name="l{0}"><inertial>
           <origin xyz="0.5 0 0"/><mass value="5"/>
           <inertia ixx="0.1" iyy="0.4" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial></link>)",
        i, i - 1, at);
  };
  return robot::model_from_urdf(
      R"(<robot name="r"><link name="l0"/>)" + link(1, 0) + link(2, 1) + "</robot>", "two links");
}

/// The peers of a tick, Merson at 1e-9 over 50 us: bare Simbody, Simbody and the native mechanics
/// behind `plant::Arm`: `Peer/<which>/<joints>`.
void Peer(benchmark::State& bench) {
  const robot::Model robot = tree(static_cast<int>(bench.range(1)));
  const robot::Vector torque = 10 * robot::mass_matrix(robot, start(robot.num_joints).q).diagonal();
  plant::ArmOptions options;
  if (bench.range(0) == 2) options.mechanics = plant::Mechanics::native;
  plant::Arm arm(robot, options, start(robot.num_joints));
  BareSimbody bare(robot, 0.3, 0.5, options.accuracy);
  // They compute the same: two integrators of accuracy 1e-9, ten ticks.
  std::int64_t k = 0;
  const auto advance = [&](bool mine, bool other) {
    ++k;
    const robot::Vector tau = k % 2 == 0 ? torque : robot::Vector(-torque);
    const double time_s = static_cast<double>(k) * 50e-6;
    if (mine) arm.advance(tau, time_s);
    if (other) bare.advance(tau, time_s);
  };
  while (k < 10) advance(true, true);
  if (std::abs(arm.state().q[0] - bare.q(0)) > 1e-8) bench.SkipWithError("not the same robot");
  const bool is_bare = bench.range(0) == 0;
  for (auto _ : bench) advance(!is_bare, is_bare);
}
BENCHMARK(Peer)->ArgNames({"which", "joints"})->ArgsProduct({{0, 1, 2}, {2, 7}});

}  // namespace

BENCHMARK_MAIN();
