#include "certificate/sampled_certificate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/certificate/scenarios.h"

namespace tachless::certificate {
namespace {

using namespace testing;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(Verdict, EveryShippedScenarioIsStable) {
  for (const char* name :
       {"flexible_regulation", "iiwa_point_to_point", "paper_flexible", "paper_rigid",
        "paper_rigid_offset", "practical_flexible", "practical_rigid", "regulation"}) {
    const Verdict result = verdict(shipped(name));
    EXPECT_TRUE(result.unknown.empty() && result.stable) << name;
    ASSERT_TRUE(result.limit_s) << name;
    EXPECT_GT(*result.limit_s, result.period_s) << name;
    EXPECT_GT(result.phase_margin_deg, 1) << name;
  }
}

/// The limits are those that an independent program found
/// (tests/certificate/sampled_limit_test.cpp); the verdict's are searched to 0.2 %.
TEST(Verdict, LimitIsTheSampledLoops) {
  const struct {
    const char* scenario;
    std::vector<std::string> set;
    double limit_s;
  } rows[] = {{"paper_rigid", {}, 1.0191e-4},
              {"paper_rigid", {"loop.command_delay=1"}, 3.4224e-5},
              {"paper_flexible", {}, 1.7679e-5},
              {"practical_rigid", {"loop.command_delay=0"}, 8.93e-3},
              {"practical_rigid", {}, 3.6e-3}};
  for (const auto& row : rows) {
    const Verdict result = verdict(shipped(row.scenario, row.set));
    ASSERT_TRUE(result.limit_s) << row.scenario;
    EXPECT_NEAR(*result.limit_s, row.limit_s, 0.01 * row.limit_s) << row.scenario;
    EXPECT_EQ(result.stable, result.period_s < row.limit_s) << row.scenario;
  }
}

TEST(Verdict, SaysStableLimitMarginAndSettling) {
  const std::string line = text(verdict(shipped("practical_rigid")));
  EXPECT_THAT(line, StartsWith("stable at 1 kHz with 1 tick of delay: limit 3."));
  EXPECT_THAT(line, HasSubstr(" ms, phase margin "));
  EXPECT_THAT(line, HasSubstr("°, settles in 0.1"));
}

TEST(Verdict, RefusalNamesLimitPeriodAndWhatToType) {
  const Verdict result = verdict(shipped("paper_rigid", {"loop.command_delay=1"}));
  EXPECT_FALSE(result.stable);
  const std::string line = refusal(result, "s.yaml");
  EXPECT_THAT(line, StartsWith("s.yaml: unstable at 20 kHz with 1 tick of delay: the largest "
                               "stable period is 34."));
  EXPECT_THAT(line, HasSubstr("type --set loop.period_s=2e-05 or --force"));
}

}  // namespace
}  // namespace tachless::certificate
