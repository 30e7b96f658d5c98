#include "in_process/in_process_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "controller/law/loria_ortega_rigid.h"
#include "controller/registry.h"
#include "tests/analysis/in_process/short_run.h"
#include "tests/support/limited_elbow.h"
#include "tests/support/same_bits.h"

namespace tachless::in_process {
namespace {

using ::testing::HasSubstr;

TEST(InProcessLoop, IsAFunctionOfItsScenario) {
  const scenario::Scenario scenario = practical({"plant.encoder.noise_std_rad=1e-5"});
  const auto once = records(scenario), again = records(scenario);
  ASSERT_EQ(once.size(), 200U);
  ASSERT_EQ(again.size(), 200U);
  for (std::size_t k = 0; k < once.size(); ++k) {
    EXPECT_TRUE(same_bits(once[k].truth.q, again[k].truth.q));
    EXPECT_TRUE(same_bits(once[k].command.tau, again[k].command.tau));
  }
}

TEST(InProcessLoop, StepsTickByTickAtMultiplesOfThePeriod) {
  const auto all = records(practical());
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_EQ(all[k].tick, static_cast<std::int64_t>(k));
    EXPECT_EQ(all[k].time_s, static_cast<double>(k) * 1e-3);
  }
}

TEST(InProcessLoop, AppliesACommandOneTickLateWithDelayOne) {
  const auto all = records(practical());
  EXPECT_TRUE(same_bits(all[0].applied.tau, Vector::Zero(2)));
  for (std::size_t k = 1; k < all.size(); ++k) {
    EXPECT_TRUE(same_bits(all[k].applied.tau, all[k - 1].command.tau));
  }
}

TEST(InProcessLoop, RecordsWhatMakesTheLawRepeatItself) {
  const scenario::Scenario scenario = practical();
  const auto all = records(scenario);
  const auto law = controller::make_law<controller::law::LoriaOrtegaRigid>(scenario);
  auto memory =
      law.start(std::get<messages::PositionMeasurement>(all[0].measurement), all[0].reference);
  for (const TickRecord& record : all) {
    const auto step = law.step(memory, std::get<messages::PositionMeasurement>(record.measurement),
                               record.reference);
    memory = step.memory;
    EXPECT_TRUE(same_bits(step.command.tau, record.command.tau));
  }
}

TEST(InProcessLoop, EndsEarlyWhenAskedTo) {
  int calls = 0;
  run_in_process(practical(), [&](const TickRecord&) { return ++calls < 7; });
  EXPECT_EQ(calls, 7);
}

TEST(InProcessLoop, StopsAtALimitOfTheRobotUnlessTheScenarioOnlyWarnsOfIt) {
  const auto limited = [](const char* on_limit) {
    return with_limited_elbow(practical({std::string("plant.on_limit=") + on_limit}),
                              R"(lower="-3" upper="3" effort="1000" velocity="0.5")");
  };
  std::size_t beyond = 0;
  const auto all = records(limited("warn"));
  for (const TickRecord& record : all) {
    EXPECT_EQ(record.beyond_limit[1], std::abs(record.truth.v[1]) > 0.5);
    beyond += record.beyond_limit[1] ? 1 : 0;
  }
  EXPECT_EQ(all.size(), 200U);
  EXPECT_GT(beyond, 0U);
  try {
    records(limited("stop"));
    FAIL() << "the elbow was too fast";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::protective_stop);
    EXPECT_THAT(failure.what(), HasSubstr("faster than its limit of 0.5 rad/s"));
  }
}

TEST(InProcessLoop, SaysInWhichTickAnUnstableLoopEnds) {
  try {
    run_in_process(
        practical({"loop.period_s=0.05", "loop.duration_s=40", "plant.integrator.accuracy=1e-3"}),
        [](const TickRecord&) { return true; });
    FAIL() << "a loop far beyond its largest stable period ran to its end";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::protective_stop);
    EXPECT_THAT(failure.what(), HasSubstr("tick "));
  }
}

/// zhang_dawson has no torque when its filter reaches 1, as after a start 5 rad/s off the
/// reference.
TEST(InProcessLoop, SaysInWhichTickALawHasNoFiniteTorque) {
  const auto run = [](const char* speed) {
    return records(practical({"controller.law=zhang_dawson", "controller.gains={k: 150}",
                              std::string("plant.initial.velocity_rad_per_s=") + speed}));
  };
  EXPECT_EQ(run("[1, 1]").size(), 200U);
  try {
    run("[1, 6]");
    FAIL() << "the filter stayed below 1";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::protective_stop);
    EXPECT_THAT(failure.what(), HasSubstr("at tick 2 is not finite"));
  }
}

TEST(InProcessLoop, RefusesALawWhoseEncodersAreMissing) {
  const auto path = std::string(TACHLESS_SOURCE_DIR) + "/scenarios/paper_flexible.yaml";
  const auto run = [&](const std::string& side) {
    run_in_process(
        scenario::load_scenario(path, {"loop.duration_s=1e-4", "plant.encoder.side=" + side}),
        [](const TickRecord&) { return true; });
  };
  EXPECT_NO_THROW(run("both"));
  for (const char* side : {"link", "motor"}) {
    try {
      run(side);
      FAIL() << side;
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      EXPECT_THAT(failure.what(), HasSubstr("plant.encoder.side"));
    }
  }
}

}  // namespace
}  // namespace tachless::in_process
