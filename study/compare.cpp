#include "study/compare.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "certificate/scenario_loop.h"
#include "controller/registry.h"

namespace tachless::study {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int postures = 5;            // of the reference, for the largest stable period
constexpr std::size_t timed = 20'000;  // ticks at most, for the time of a step

/// What the law was fed in the first ticks, and what it commanded in all.
struct Recorded {
  std::vector<loop::AnyMeasurement> measurements;
  std::vector<loop::ReferencePoint> references;
  std::vector<robot::Vector> torques;
};

/// Root mean square error of the encoders, over all joints [rad; m]; 0 when they are exact.
double encoder_error(const experiment::Scenario& scenario) {
  const robot::Vector count = experiment::encoder_count(scenario, *scenario.model);
  const double noise = scenario.plant.encoder.noise_std_rad;
  return std::sqrt(count.squaredNorm() / (12.0 * scenario.num_joints) + noise * noise);
}

/// Of the scenario's run with those torques, against its twin with exact encoders.
std::optional<double> amplification(const experiment::Scenario& scenario,
                                    const std::vector<robot::Vector>& torques) {
  const std::int64_t ticks = scenario.loop.num_ticks;
  const double error = encoder_error(scenario);
  if (error == 0 || static_cast<std::int64_t>(torques.size()) != ticks) return {};
  experiment::Scenario exact = scenario;
  exact.plant.encoder.resolution_bits.reset();
  exact.plant.encoder.noise_std_rad = 0;
  exact.plant.encoder.velocity_noise_std_rad_per_s = 0;
  double sum = 0;
  const auto run = measure(exact, [&](const TickRecord& tick) {
    sum += (torques[static_cast<std::size_t>(tick.tick)] - tick.command.tau).squaredNorm();
    return true;
  });
  if (run->ticks != ticks) return {};
  return std::sqrt(sum / (static_cast<double>(ticks) * scenario.num_joints)) / error;
}

std::optional<double> largest_period(const experiment::Scenario& scenario) {
  if (!controller::law_facts(scenario.controller.law).no_linearisation.empty()) return {};
  const certificate::ScenarioLoop loop(scenario);
  double shortest = std::numeric_limits<double>::infinity();
  for (const loop::ReferencePoint& rest : loop.rests(postures)) {
    const auto limit = certificate::largest_stable_period(loop.at(rest));
    if (!limit) return {};
    shortest = std::min(shortest, *limit);
  }
  return shortest;
}

/// Median of five passes over what was recorded.
double step_time_us(const experiment::Scenario& scenario, const Recorded& recorded) {
  std::vector<double> passes;
  for (int pass = 0; pass < 5 && !recorded.measurements.empty(); ++pass) {
    const controller::ScenarioLaw law = controller::scenario_law(scenario);
    const Clock::time_point begun = Clock::now();
    for (std::size_t k = 0; k < recorded.measurements.size(); ++k) {
      const auto tick = static_cast<std::int64_t>(k);
      law->step(tick, recorded.measurements[k], recorded.references[k]);
      law->keep(tick);
    }
    const std::chrono::duration<double, std::micro> passed = Clock::now() - begun;
    passes.push_back(passed.count() / static_cast<double>(recorded.measurements.size()));
  }
  if (passes.empty()) return NAN;
  std::ranges::sort(passes);
  return passes[passes.size() / 2];
}

}  // namespace

Compared compare(const experiment::Scenario& scenario, int seeds) {
  Compared compared;
  compared.law = scenario.controller.law;
  compared.measures = controller::law_facts(compared.law).measurement;
  Recorded recorded;
  compared.run = *measure(scenario, [&](const TickRecord& tick) {
    if (recorded.measurements.size() < timed) {
      recorded.measurements.push_back(tick.measurement);
      recorded.references.push_back(tick.reference);
    }
    recorded.torques.push_back(tick.command.tau);
    compared.error.add(tick.time_s, (tick.truth.q - tick.reference.q_ref).norm());
    compared.torque.add(tick.time_s, tick.applied.tau.norm());
    return true;
  });
  compared.least_settled_error = compared.largest_settled_error = compared.run.settled_error;
  for (int i = 1; i < seeds; ++i) {
    experiment::Scenario with_seed = scenario;
    with_seed.plant.encoder.seed += static_cast<std::uint64_t>(i);
    const Measures run = *measure(with_seed);
    // A run that was broken off has none: then the largest has none.
    compared.least_settled_error = std::fmin(compared.least_settled_error, run.settled_error);
    if (!(run.settled_error <= compared.largest_settled_error)) {
      compared.largest_settled_error = run.settled_error;
    }
  }
  compared.noise_amplification = amplification(scenario, recorded.torques);
  compared.largest_period_s = largest_period(scenario);
  compared.step_us = step_time_us(scenario, recorded);
  return compared;
}

}  // namespace tachless::study
