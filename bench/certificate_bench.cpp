// What a certificate costs: the verdict that `run` gives before it starts (bar: 0.1 s for seven
// joints), and all that `certify` computes (bars: 2 s for two joints, 60 s for seven).
#include <benchmark/benchmark.h>

#include <string>

#include "certificate/certify.h"
#include "certificate/feasibility.h"
#include "certificate/sampled_certificate.h"

using namespace tachless;

namespace {

experiment::Scenario load(const std::string& name) {
  return experiment::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/" + name + ".yaml");
}

void verdict(benchmark::State& bench, const std::string& name) {
  const experiment::Scenario scenario = load(name);
  for (auto _ : bench) {
    benchmark::DoNotOptimize(certificate::verdict(scenario));
    benchmark::DoNotOptimize(certificate::feasibility(scenario));
  }
}

void certify(benchmark::State& bench, const std::string& name) {
  const experiment::Scenario scenario = load(name);
  for (auto _ : bench) benchmark::DoNotOptimize(certificate::certify(scenario));
}

BENCHMARK_CAPTURE(verdict, two_joints, "practical_rigid")->UseRealTime();
BENCHMARK_CAPTURE(verdict, two_flexible_joints, "practical_flexible")->UseRealTime();
BENCHMARK_CAPTURE(verdict, seven_joints, "iiwa_point_to_point")->UseRealTime();
BENCHMARK_CAPTURE(certify, two_joints, "practical_rigid")
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);
BENCHMARK_CAPTURE(certify, two_flexible_joints, "practical_flexible")
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);
BENCHMARK_CAPTURE(certify, seven_joints, "iiwa_point_to_point")
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Iterations(1)
    ->Unit(benchmark::kSecond);

}  // namespace

BENCHMARK_MAIN();
