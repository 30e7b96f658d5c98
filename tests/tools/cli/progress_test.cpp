#include "cli/progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tachless::cli::progress_test {
namespace {

using std::chrono::milliseconds;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Progress, WaitsBeforeTheFirstTick) {
  Progress progress(1000, 1e-3);
  EXPECT_THAT(progress.line(), HasSubstr("waiting"));
  progress.note(-1, 0, Progress::Clock::time_point{});
  EXPECT_THAT(progress.line(), HasSubstr("waiting"));
}

TEST(Progress, ShowsTimeRateAndError) {
  Progress progress(40'000, 5e-5);
  Progress::Clock::time_point now{};
  progress.note(100, 1, now);
  progress.note(9'399, 3.2e-4, now + milliseconds(1000));
  EXPECT_THAT(progress.line(), AllOf(HasSubstr("0.470 of 2 s"), HasSubstr("9.3 k ticks/s"),
                                     HasSubstr("|e| 3.2e-04 rad")));
}

TEST(Progress, HasTheUnitOfItsJoints) {
  Progress progress(1000, 1e-3, "rad, m");
  progress.note(100, 3.2e-4, {});
  EXPECT_THAT(progress.line(), HasSubstr("|e| 3.2e-04 rad, m"));
}

TEST(Progress, ForgetsTheRateOfLongAgo) {
  Progress progress(1'000'000, 1e-3);
  Progress::Clock::time_point now{};
  progress.note(0, 0, now);
  progress.note(10'000, 0, now + milliseconds(1000));
  progress.note(10'100, 0, now + milliseconds(2000));
  EXPECT_THAT(progress.line(), HasSubstr("  100 ticks/s"));
}

TEST(Progress, IgnoresAHeartbeatFromThePast) {
  Progress progress(1000, 1e-3);
  progress.note(500, 0.5, Progress::Clock::time_point{});
  progress.note(400, 0.25, Progress::Clock::time_point{});
  EXPECT_THAT(progress.line(), AllOf(HasSubstr("0.501 of 1 s"), HasSubstr("5.0e-01")));
}

TEST(Progress, FillsItsBarAtTheLastTickOnly) {
  Progress progress(1000, 1e-3);
  progress.note(998, 0, Progress::Clock::time_point{});
  EXPECT_THAT(progress.line(), Not(HasSubstr("[====================]")));
  progress.note(999, 0, Progress::Clock::time_point{});
  EXPECT_THAT(progress.line(), HasSubstr("[====================]"));
}

}  // namespace
}  // namespace tachless::cli::progress_test
