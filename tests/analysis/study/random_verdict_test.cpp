// Verdicts on random scenarios, judged by a second simulation: it goes on, with shorter steps.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "scenario/scenario.h"
#include "study/measures.h"

namespace tachless::study {
namespace {

constexpr double length_s = 2;

/// A share 0 … 1 that is the same with every standard library.
double share(std::mt19937& random) { return static_cast<double>(random()) / 4294967296.0; }

struct RandomScenario {
  std::vector<std::string> overrides;
  double noise = 0;
};

RandomScenario random_scenario(std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto chance = [&](double of) { return share(random) < of; };
  const double w = 4 * std::pow(10.0, 1.3 * share(random));  // bandwidth [1/s]
  const double damping = 0.5 + share(random);
  RandomScenario result;
  const std::vector<double> inertia = {9, 0.7};
  std::vector<double> kp, kd;
  for (const double m : inertia) {
    kp.push_back(m * w * w);
    kd.push_back(2 * damping * m * w);
  }
  std::vector<std::string>& set = result.overrides;
  set = {"plant.mechanics=native", "plant.integrator.accuracy=1e-6", "plant.on_limit=warn",
         fmt::format("controller.gains={{kp: [{}, {}], kd: [{}, {}], a: {}, b: {}}}", kp[0], kp[1],
                     kd[0], kd[1], 8 * w, 8 * w)};
  if (chance(0.3)) {
    result.noise = 1e-5 * std::pow(10.0, 2 * share(random));
    set.push_back(fmt::format("plant.encoder.noise_std_rad={}", result.noise));
  }
  if (chance(0.3)) set.push_back(fmt::format("plant.payload.mass_kg={}", 2 * share(random)));
  if (chance(0.2)) {
    set.push_back(
        fmt::format("plant.drive.coulomb_friction_Nm=[{}, {}]", 5 * share(random), share(random)));
  }
  if (chance(0.2))
    set.push_back(fmt::format("plant.drive.torque_scale={}", 0.8 + 0.4 * share(random)));
  if (chance(0.3)) set.push_back(fmt::format("loop.command_delay={}", random() % 4));
  const double q1 = share(random) - 0.5, q2 = share(random) - 0.5;
  const double kind = share(random);
  if (kind < 0.35) {
    set.push_back(fmt::format("reference={{hold: {{position_rad: [{}, {}]}}}}", q1, q2));
  } else if (kind < 0.7) {
    set.push_back(
        fmt::format("reference={{sinusoid: {{amplitude_rad: [{}, {}], frequency_hz: 2, "
                    "offset_rad: [{}, {}]}}}}",
                    0.1 * share(random), 0.05 * share(random), q1, q2));
  } else {
    set.push_back(
        fmt::format("reference={{point_to_point: {{from_rad: [{}, {}], to_rad: [{}, {}], "
                    "start_s: 0.1, duration_s: 0.5}}}}",
                    q1, q2, q1 + 0.2 * share(random), q2 - 0.2 * share(random)));
  }
  const double beside = chance(0.7) ? 0.1 : 0;
  set.push_back(fmt::format("plant.initial.position_rad=[{}, {}]",
                            q1 + beside * (share(random) - 0.5),
                            q2 + beside * (share(random) - 0.5)));
  return result;
}

scenario::Scenario scenario_of(std::vector<std::string> overrides, double duration_s) {
  overrides.push_back(fmt::format("loop.duration_s={}", duration_s));
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml", overrides);
}

/// The error of one joint over the last part of a longer run, integrated with a tenth of the step:
/// the method is of order 4, and the accuracy of a step 1e-4 times that of the judged run.
struct Continuation {
  double peak = 0, mean = 0;
  bool whole = true;  ///< it was not broken off

  Continuation(const RandomScenario& of, std::size_t joint, double duration_s, double last_s) {
    std::vector<std::string> overrides = of.overrides;
    overrides.emplace_back("plant.integrator.accuracy=1e-10");
    const scenario::Scenario scenario = scenario_of(overrides, duration_s);
    std::int64_t count = 0;
    const auto run = measure(scenario, [&](const in_process::TickRecord& record) {
      if (record.time_s < duration_s - last_s) return true;
      const auto i = static_cast<Eigen::Index>(joint);
      const double error = record.truth.q[i] - record.reference.q_ref[i];
      peak = std::max(peak, std::abs(error));
      mean += error;
      ++count;
      return true;
    });
    mean = std::abs(mean) / static_cast<double>(std::max<std::int64_t>(1, count));
    whole = run->ticks == scenario.loop.num_ticks;
  }
};

/// Returns why the word is false; empty: it is true.
std::string refuted(const RandomScenario& scenario, const Verdict& seen) {
  const Continuation next(scenario, seen.joint, 6 * length_s, length_s);
  // Noise of an encoder makes an error of its own size; a loop with little damping doubles it.
  const double noise = 12 * scenario.noise + 2e-5;
  switch (seen.outcome) {
    case Outcome::converged:
      if (!next.whole || next.peak > 0.012 * seen.error / std::max(seen.share, 1e-9) + noise)
        return fmt::format("the error becomes {:.3g}", next.peak);
      return "";
    case Outcome::lags:
      // The rest of the start may cancel up to half of the error that the motion makes.
      if (!next.whole || next.peak > 2 * seen.error + noise)
        return fmt::format("the error becomes {:.3g}", next.peak);
      if (seen.cause == Cause::settling && seen.loop_settles_s <= seen.rested_s &&
          next.peak > 0.95 * seen.error + noise)
        return fmt::format("the error stays {:.3g}", next.peak);
      return "";
    case Outcome::rests_beside:
      if (!next.whole || next.peak < 0.7 * seen.error - noise ||
          next.peak > 1.5 * seen.error + noise)
        return fmt::format("the error becomes {:.3g}", next.peak);
      return "";
    case Outcome::oscillates:
      if (next.whole && next.peak < 0.5 * seen.error)
        return fmt::format("the error becomes {:.3g}", next.peak);
      return "";
    case Outcome::diverging:
      if (next.whole && next.peak < 1.2 * seen.error)
        return fmt::format("the error becomes {:.3g}", next.peak);
      return "";
    default:
      return "";
  }
}

/// TACHLESS_RANDOM_VERDICTS=1000 tries 1000 scenarios.
TEST(Verdict, OfARandomScenarioIsTrueWhenTheRunGoesOn) {
  const char* const wanted = std::getenv("TACHLESS_RANDOM_VERDICTS");
  const std::uint32_t scenarios =
      wanted != nullptr ? static_cast<std::uint32_t>(std::stoul(wanted)) : 100;
  std::array<int, names(Outcome()).size()> count{};
  for (std::uint32_t seed = 1; seed <= scenarios; ++seed) {
    const RandomScenario scenario = random_scenario(seed);
    const scenario::Scenario made = scenario_of(scenario.overrides, length_s);
    const Verdict seen = measure(made)->verdict;
    ++count[static_cast<std::size_t>(seen.outcome)];
    EXPECT_EQ(refuted(scenario, seen), "")
        << seed << ": " << text(seen, robot::joint_labels(*made.model));
  }
  for (std::size_t i = 0; i < count.size(); ++i) {
    RecordProperty(std::string(names(Outcome())[i]), count[i]);
  }
}

}  // namespace
}  // namespace tachless::study
