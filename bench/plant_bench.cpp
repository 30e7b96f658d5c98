#include <benchmark/benchmark.h>

#include <cstdint>

#include "plant/arm.h"
#include "robot/dynamics.h"
#include "tests/core/robot/robots.h"

using namespace tachless;

/// Times a step of the plant, Merson at 1e-9: a tick of 50 us with a torque that jumps every tick.
/// The benchmark covers both sources of mechanics (0: Simbody, 1: native): `Step/<which>/<joints>`.
static void Step(benchmark::State& bench) {
  const robot::Model robot =
      bench.range(1) == 2 ? robot::testing::two_link() : robot::testing::iiwa7();
  plant::ArmOptions options;
  if (bench.range(0) == 1) options.mechanics = plant::Mechanics::native;
  plant::ArmState start;
  start.q = Vector::Constant(robot.num_joints, 0.3);
  start.v = Vector::Constant(robot.num_joints, 0.5);
  const Vector torque = 10 * robot::mass_matrix(robot, start.q).diagonal();
  plant::Arm arm(robot, options, start);
  std::int64_t k = 0;
  for (auto _ : bench) {
    ++k;
    arm.advance(k % 2 == 0 ? torque : Vector(-torque), static_cast<double>(k) * 50e-6);
  }
}
BENCHMARK(Step)->ArgNames({"which", "joints"})->ArgsProduct({{0, 1}, {2, 7}});

BENCHMARK_MAIN();
