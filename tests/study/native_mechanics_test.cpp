// The shipped experiments on the plant's native mechanics, against Simbody's.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "experiment/scenario.h"
#include "study/in_process_loop.h"

namespace tachless::study {
namespace {

constexpr int num_ticks = 400;

std::vector<robot::Vector> motion(const std::filesystem::path& path, const std::string& mechanics) {
  std::vector<robot::Vector> q;
  const auto scenario = experiment::load_scenario(
      path, {"plant.mechanics=" + mechanics, "plant.encoder.resolution_bits=null"});
  run_in_process(scenario, [&](const TickRecord& record) {
    q.push_back(record.truth.q);
    return record.tick < num_ticks;
  });
  return q;
}

// The scenarios integrate to a local error of 1e-9 and better, and their loops are stable, so the
// difference of the two mechanics does not grow: some ticks' worth of it at most. With exact
// encoders: a position beside the edge of a count would make a count of any difference.
TEST(NativeMechanics, MoveEveryShippedScenarioAsSimbodyDoes) {
  int scenarios = 0;
  const std::filesystem::path folder = std::filesystem::path(TACHLESS_SOURCE_DIR) / "scenarios";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++scenarios;
    const auto simbody = motion(entry.path(), "simbody");
    const auto native = motion(entry.path(), "native");
    ASSERT_EQ(native.size(), simbody.size());
    double largest = 0;
    for (std::size_t k = 0; k < native.size(); ++k) {
      largest = std::max(largest, (native[k] - simbody[k]).cwiseAbs().maxCoeff());
    }
    EXPECT_LT(largest, 1e-10) << entry.path();
    EXPECT_GT(largest, 0) << entry.path() << ": the same mechanics twice?";
  }
  EXPECT_GE(scenarios, 8);
}

}  // namespace
}  // namespace tachless::study
