#include "tests/campaign/plan.h"

#include <gtest/gtest.h>

#include <map>
#include <string>

namespace tachless::campaign {
namespace {

TEST(APlan, FollowsFromItsSeed) {
  EXPECT_EQ(describe(plan_of(5)), describe(plan_of(5)));
  EXPECT_NE(describe(plan_of(5)), describe(plan_of(6)));
}

TEST(Plans, AreOfEveryKindAmongTheFirstThousand) {
  std::map<std::string, int> seen;
  int must_end_well = 0;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    const Plan plan = plan_of(seed);
    ++seen[kind_of(plan)];
    must_end_well += plan.must_end_well() ? 1 : 0;
  }
  for (const std::string key : {"keyed", "plain"}) {
    for (const std::string what : {"", ", lies", ", replays"}) {
      EXPECT_GT(seen[key + " lockstep" + what], 0) << key << what;
      for (const std::string mishap : {", kill", ", stop", ", interrupt"}) {
        EXPECT_GT(seen[key + " lockstep" + what + mishap], 0) << key << what << mishap;
      }
    }
    EXPECT_GT(seen[key + " realtime, lies"], 0);
    EXPECT_GT(seen[key + " long realtime, lies, kill"], 0);
  }
  EXPECT_GT(must_end_well, 300);
  EXPECT_LT(must_end_well, 700);
}

TEST(APlan, MustEndWellWithAKeyAndUnderCopiesAndNotWithoutOneUnderLies) {
  Plan plan;
  EXPECT_TRUE(plan.must_end_well());
  plan.hostility.emplace().replays = true;
  EXPECT_TRUE(plan.must_end_well());
  plan.hostility->forges = true;
  EXPECT_FALSE(plan.must_end_well());
  plan.keyed = true;
  EXPECT_TRUE(plan.must_end_well());
  plan.mishap.emplace().kind = Mishap::Kind::kill;
  EXPECT_FALSE(plan.must_end_well());
  plan.mishap->kind = Mishap::Kind::stop;
  EXPECT_TRUE(plan.must_end_well());
}

}  // namespace
}  // namespace tachless::campaign
