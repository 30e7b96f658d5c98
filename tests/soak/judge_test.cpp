// What the judge makes of an observation. That it notices what programs do wrong: runner_test.cpp.

#include "tests/soak/judge.h"

#include <gmock/gmock.h>

#include "tests/support/temporary_directory.h"

namespace tachless::soak {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Judge, HoldsAProcessToTheGrowthOfMemoryThatIsPromised) {
  const TemporaryDirectory directory;
  Round round = plan_round(0);
  round.scenario = "practical_rigid";
  const Spec spec = specify({.program = "/bin/true",
                             .directory = directory.path(),
                             .scenarios = TACHLESS_SOURCE_DIR "/scenarios",
                             .num_ticks = 4'000,
                             .most_growth_kib = 1024},
                            round, directory / "out");
  Observation seen;
  seen.memory["tachless-plant"] = {.early = 30'000, .peak = 31'025};
  seen.memory["tachless-logger"] = {.early = 30'000, .peak = 31'024};
  const Verdict verdict = judge(spec, seen, std::nullopt);
  EXPECT_THAT(verdict.problems, Contains("tachless-plant grew from 30000 to 31025 KiB"));
  EXPECT_THAT(verdict.problems, Not(Contains(HasSubstr("tachless-logger"))));
}

}  // namespace
}  // namespace tachless::soak
