#include <benchmark/benchmark.h>

#include <cstdint>
#include <string>
#include <vector>

#include "own_loop/own_loop.h"

using namespace tachless;

namespace {

/// Times a tick of the law in a loop of one's own. `Tick/<joints>/<guards>`: the scenario's
/// reference, readings that change, with guards or without.
void Tick(benchmark::State& bench) {
  const std::string scenario = bench.range(0) == 2 ? "practical_rigid" : "iiwa_point_to_point";
  own_loop::Loop loop(TACHLESS_SOURCE_DIR "/scenarios/" + scenario + ".yaml",
                      {"plant.drive.torque_limit_Nm=1000", "plant.following_error_rad=10"});
  Guards guards(loop);
  const own_loop::Numbers start = loop.planned(0).position;
  std::vector<double> q(start.begin(), start.end());
  std::int64_t k = 0;
  for (auto _ : bench) {
    q[0] = 1e-9 * static_cast<double>(k % 1000);
    const own_loop::Step step = loop.torque(k, q);
    ++k;
    if (bench.range(1) == 0) {
      benchmark::DoNotOptimize(step.tau[0]);
    } else {
      benchmark::DoNotOptimize(guards.check(step).tau[0]);
    }
  }
}
BENCHMARK(Tick)->ArgNames({"joints", "guards"})->ArgsProduct({{2, 7}, {0, 1}});

}  // namespace

BENCHMARK_MAIN();
