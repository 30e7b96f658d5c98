#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

#include "plant/arm.h"
#include "robot/mass_matrix.h"

using namespace tachless;

/// What a tick costs the plant, for each integrator, at 2 and 7 joints, with the torque jumping
/// every tick: `Tick/<integrator>/<joints>/<-log10 accuracy>/<period in us>`. At 50 us (the period
/// of paper_rigid) and 1000 us (practical_rigid).
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

void Acceleration(benchmark::State& bench) {
  const int joints = static_cast<int>(bench.range(0));
  const plant::Arm arm(model(joints), {}, start(joints));
  const robot::Vector tau = robot::Vector::Constant(joints, 1);
  for (auto _ : bench) benchmark::DoNotOptimize(arm.acceleration(tau));
}
BENCHMARK(Acceleration)->Arg(2)->Arg(7);

void Tick(benchmark::State& bench) {
  const int joints = static_cast<int>(bench.range(1));
  plant::ArmOptions options;
  options.integrator = static_cast<plant::Integrator>(bench.range(0));
  options.accuracy = std::pow(10.0, -static_cast<double>(bench.range(2)));
  const double h = static_cast<double>(bench.range(3)) * 1e-6;
  const robot::Model robot = model(joints);
  plant::Arm arm(robot, options, start(joints));
  // Jumps of 20 rad/s^2 at every joint.
  const robot::Vector torque = 10 * robot::mass_matrix(robot, start(joints).q).diagonal();
  robot::Vector tau = torque;
  std::int64_t k = 0;
  for (auto _ : bench) {
    ++k;
    tau = k % 2 == 0 ? torque : -torque;
    arm.advance(tau, static_cast<double>(k) * h);
  }
  bench.counters["steps"] =
      static_cast<double>(arm.integrator_steps()) / static_cast<double>(bench.iterations());
}
BENCHMARK(Tick)
    ->ArgNames({"integrator", "joints", "accuracy", "period"})
    ->ArgsProduct({{0, 1, 2, 3, 4, 5}, {2, 7}, {6}, {50}})
    ->ArgsProduct({{0, 1, 2}, {2, 7}, {9}, {50, 1000}})
    ->ArgsProduct({{0, 1, 2}, {2}, {11}, {50, 1000}});

}  // namespace

BENCHMARK_MAIN();
