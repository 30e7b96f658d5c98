#include "tests/soak/plan.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <set>

namespace tachless::soak {
namespace {

TEST(SoakPlan, FollowsFromTheSeed) {
  for (const std::uint64_t seed : {1ULL, 17ULL, 123'456'789ULL}) {
    const Round once = plan_round(seed);
    const Round again = plan_round(seed);
    EXPECT_EQ(describe(once), describe(again));
    EXPECT_EQ(once.scenario, again.scenario);
    EXPECT_EQ(once.moment, again.moment);
    EXPECT_EQ(once.seed, seed);
  }
}

TEST(SoakPlan, GoesThroughAllFaultsInSeedsInARow) {
  for (const std::uint64_t first : {0ULL, 5ULL, 1'000ULL}) {
    std::set<std::string> faults;
    for (std::uint64_t i = 0; i < num_faults; ++i) {
      faults.insert(name_of(plan_round(first + i).fault));
    }
    EXPECT_EQ(faults.size(), std::size_t{num_faults});
  }
}

TEST(SoakPlan, HasRoomAfterEachFaultAndNamesScenariosThatExist) {
  std::set<loop::Role> killed;
  for (std::uint64_t seed = 0; seed < 1'000; ++seed) {
    const Round round = plan_round(seed);
    EXPECT_TRUE(
        std::filesystem::exists(TACHLESS_SOURCE_DIR "/scenarios/" + round.scenario + ".yaml"))
        << round.scenario;
    EXPECT_GE(round.moment, 0.1);
    EXPECT_LE(round.moment, 0.51);
    EXPECT_GE(round.loss_percent, 1);
    EXPECT_LE(round.loss_percent, 15);
    if (round.fault == Fault::kill) killed.insert(round.victim);
  }
  EXPECT_EQ(killed.size(), std::size_t{loop::num_roles});
}

}  // namespace
}  // namespace tachless::soak
