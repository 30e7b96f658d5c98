// The shipped experiments on the plant's native mechanics, against Simbody's.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "experiment/scenario.h"
#include "study/in_process_loop.h"

namespace tachless::study {
namespace {

// The loops are stable and integrated to a local error of 1e-12, so the difference of the two
// mechanics does not grow: some ticks' worth of it at most. Velocities are off by that times the
// rates of the loops' fastest modes, up to 1e4 1/s.
constexpr double agreement = 1e-10, agreement_of_velocity = 1e-8;

TEST(NativeMechanics, MoveEveryShippedScenarioAsSimbodyDoes) {
  int scenarios = 0;
  const std::filesystem::path folder = std::filesystem::path(TACHLESS_SOURCE_DIR) / "scenarios";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++scenarios;
    const double period_s = experiment::load_scenario(entry.path()).loop.period_s;
    const auto scenario = experiment::load_scenario(
        entry.path(), {fmt::format("loop.duration_s={}", 400 * period_s)});
    const CrossCheck check = cross_check(scenario);
    EXPECT_EQ(check.ticks, 400) << entry.path();
    EXPECT_LT(check.position, agreement) << entry.path();
    EXPECT_LT(check.velocity, agreement_of_velocity) << entry.path();
    EXPECT_GT(check.position, 0) << entry.path() << ": the same mechanics twice?";
  }
  EXPECT_GE(scenarios, 8);
}

TEST(NativeMechanics, MoveAPlantAsRoughAsRealityAsSimbodyDoes) {
  const auto scenario = experiment::load_scenario(
      TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
      {"loop.duration_s=0.5", "plant.encoder.noise_std_rad=1e-6", "plant.encoder.latency_ticks=1",
       "plant.drive.viscous_friction_Nms_per_rad=0.5", "plant.drive.torque_limit_Nm=[700, 70]",
       "plant.payload={mass_kg: 0.5, attach_s: 0.2}",
       "plant.disturbances=[{joint: elbow, torque_Nm: 3, shape: pulse, start_s: 0.1, end_s: "
       "0.3}]"});
  const CrossCheck check = cross_check(scenario);
  EXPECT_EQ(check.ticks, 500);
  EXPECT_LT(check.position, agreement);
}

}  // namespace
}  // namespace tachless::study
