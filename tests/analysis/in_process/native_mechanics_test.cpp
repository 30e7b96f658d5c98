// Compares the shipped experiments on the plant's native mechanics with Simbody's.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "in_process/in_process_loop.h"
#include "scenario/scenario.h"

namespace tachless::in_process::native_mechanics_test {
namespace {

constexpr double finest_accuracy = 1e-12;

/// Returns the largest difference, relative for values above 1; 0 for quantities that a rigid robot
/// lacks.
double distance(const Vector& got, const Vector& expected) {
  if (got.size() == 0) return 0;
  const Vector scale = expected.cwiseAbs().cwiseMax(1.0);
  return (got - expected).cwiseQuotient(scale).cwiseAbs().maxCoeff();
}

/// Returns the scenario with that mechanics.
scenario::Scenario moved_by(std::string_view mechanics, const scenario::Scenario& scenario) {
  const double accuracy = std::min(scenario.plant.integrator.accuracy, finest_accuracy);
  return scenario::parse_scenario(
      scenario.text, scenario.robot.urdf_text, scenario.source,
      {fmt::format("plant.mechanics={}", mechanics), "plant.encoder.resolution_bits=null",
       fmt::format("plant.integrator.accuracy={}", accuracy)});
}

/// Differences between Simbody and the library's own mechanics over a run.
struct CrossCheck {
  std::int64_t ticks = 0;  ///< number of compared ticks
  // Largest difference of a true value of links and motors, relative for values above 1.
  double position = 0;    ///< [rad; m]
  double velocity = 0;    ///< [rad/s; m/s]
  std::int64_t tick = 0;  ///< tick of the largest difference in position
};

/// Steps the closed loop of the scenario twice in this process, with plant.mechanics simbody and
/// native, and compares every tick. Encoders are ideal, because a rounding difference could become
/// a difference of one count. The accuracy is 1e-12 or the scenario's, whichever is finer.
CrossCheck cross_check(const scenario::Scenario& scenario) {
  std::vector<plant::ArmState> expected;
  run_in_process(moved_by("simbody", scenario), [&](const TickRecord& record) {
    expected.push_back(record.truth);
    return true;
  });
  CrossCheck result;
  run_in_process(moved_by("native", scenario), [&](const TickRecord& record) {
    const plant::ArmState& got = record.truth;
    const plant::ArmState& other = expected.at(static_cast<std::size_t>(record.tick));
    const double position = std::max(distance(got.q, other.q), distance(got.theta, other.theta));
    if (position > result.position) {
      result.position = position;
      result.tick = record.tick;
    }
    result.velocity = std::max(
        {result.velocity, distance(got.v, other.v), distance(got.thetadot, other.thetadot)});
    ++result.ticks;
    return true;
  });
  return result;
}

// The loops are stable and integrated to a local error of 1e-12. The difference of the two
// mechanics therefore does not grow beyond that of some ticks. Velocities differ by that times the
// rates of the loops' fastest modes, up to 1e4 1/s.
constexpr double agreement = 1e-10, agreement_of_velocity = 1e-8;

TEST(NativeMechanics, MoveEveryShippedScenarioAsSimbodyDoes) {
  int scenarios = 0;
  const std::filesystem::path folder = std::filesystem::path(TACHLESS_SOURCE_DIR) / "scenarios";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++scenarios;
    const double period_s = scenario::load_scenario(entry.path()).loop.period_s;
    const auto scenario =
        scenario::load_scenario(entry.path(), {fmt::format("loop.duration_s={}", 400 * period_s)});
    const CrossCheck check = cross_check(scenario);
    EXPECT_EQ(check.ticks, 400) << entry.path();
    EXPECT_LT(check.position, agreement) << entry.path();
    EXPECT_LT(check.velocity, agreement_of_velocity) << entry.path();
    EXPECT_GT(check.position, 0) << entry.path() << ": the same mechanics twice?";
  }
  EXPECT_GE(scenarios, 8);
}

TEST(NativeMechanics, MoveAPlantAsRoughAsRealityAsSimbodyDoes) {
  const auto scenario = scenario::load_scenario(
      TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
      {"loop.duration_s=0.5", "plant.encoder.noise_std_rad=1e-6", "plant.encoder.latency_ticks=1",
       "plant.drive.viscous_friction_Nms_per_rad=0.5", "plant.drive.torque_limit_Nm=[700, 70]",
       "plant.payload={mass_kg: 0.5}",
       "plant.disturbances=[{joint: elbow, torque_Nm: 3, shape: pulse, start_s: 0.1, end_s: "
       "0.3}]"});
  const CrossCheck check = cross_check(scenario);
  EXPECT_EQ(check.ticks, 500);
  EXPECT_LT(check.position, agreement);
}

}  // namespace
}  // namespace tachless::in_process::native_mechanics_test
