#include "replay/replay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "base/failure.h"
#include "tests/support/damaged_log.h"
#include "tests/support/in_process_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::replay {
namespace {

using logger::Recorded;
using ::testing::HasSubstr;

// The canonical order is RUN_INFO, then TICK, measurement, REFERENCE, COMMAND, CONTROLLER_STATE,
// TRUTH.
std::size_t index_of(std::int64_t tick, int piece) {
  return 1 + 6 * static_cast<std::size_t>(tick) + static_cast<std::size_t>(piece);
}
constexpr int measurement = 1;
constexpr int reference = 2;
constexpr int command = 3;

// Returns the last byte of joint j. A message ends with a vector of doubles, so j is counted from
// the end.
std::size_t last_byte(const Recorded& message, int joint, int num_joints) {
  return message.data.size() - 8 * static_cast<std::size_t>(num_joints - 1 - joint) - 1;
}

class ReplayTest : public ::testing::Test {
 protected:
  logger::RunLog open(const std::vector<Recorded>& messages) {
    const auto path = directory_.path() / "lcmlog";
    logger::write_file(path, logger::log_of(messages));
    return logger::RunLog::open(path);
  }
  Replay replayed(const std::vector<Recorded>& messages) {
    logger::RunLog log = open(messages);
    return replay(log, log.scenario(), controller::scenario_law(log.scenario()));
  }

  TemporaryDirectory directory_;
};

TEST_F(ReplayTest, GivesEveryLawsCommandsAgain) {
  const std::vector<scenario::Scenario> scenarios = {
      support::shortened("paper_rigid.yaml", "0.01"),
      support::shortened("practical_rigid.yaml", "0.2"),
      support::shortened("paper_flexible.yaml", "0.001"),
      support::shortened("practical_flexible.yaml", "0.05"),
      support::shortened("regulation.yaml", "0.2"),
      support::shortened("flexible_regulation.yaml", "0.2"),
      support::shortened("iiwa_point_to_point.yaml", "0.3"),
      support::shortened("regulation.yaml", "0.1", {"controller.law=kelly_regulation"}),
      support::shortened(
          "practical_rigid.yaml", "0.05",
          {"controller.law=slotine_li", "controller.gains={lambda: 20, ks: [50, 5]}"}),
      support::shortened(
          "practical_adaptive.yaml", "0.3",
          {"controller.gains.gamma_moment=1", "controller.gains.moment_max=0.3",
           "controller.gains.gamma_inertia=0.1", "controller.gains.inertia_max=0.2",
           "controller.gains.gamma_friction=[400, 60]", "controller.gains.friction_max=[20, 5]"}),
      support::shortened("iiwa_adaptive.yaml", "0.1"),
      support::shortened("practical_rigid.yaml", "0.2",
                         {"controller.law=loria_ortega_bounded",
                          "controller.gains={kp: [40000, 2400], kd: [1000, 60], a: 1000, b: 1000, "
                          "ki: [10000, 600], eps_1: 28, eps_2: 0.14, d_max: [60, 12]}",
                          "plant.drive.torque_limit_Nm=[2000, 200]"}),
      support::shortened("practical_rigid.yaml", "0.2",
                         {"controller.law=loria_ortega_integral",
                          "controller.gains={kp: [40000, 2400], kd: [1000, 60], a: 1000, b: 1000, "
                          "ki: [10000, 600], eps_1: 28, eps_2: 0.14}",
                          "plant.drive.torque_limit_Nm=[200, 20]"}),
  };
  for (const scenario::Scenario& scenario : scenarios) {
    SCOPED_TRACE(scenario.name + ", " + scenario.controller.law);
    const Replay result = replayed(support::in_process_log(scenario));
    EXPECT_EQ(result.compared, scenario.loop.num_ticks);
    EXPECT_EQ(result.different, 0);
    EXPECT_TRUE(result.complete()) << result.stopped_by;
    EXPECT_FALSE(result.first);
  }
}

TEST_F(ReplayTest, NamesTickAndJointOfAFlippedLastBit) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.1"));
  Recorded& flipped = messages[index_of(37, command)];
  char& byte = flipped.data[last_byte(flipped, 0, 2)];
  byte = static_cast<char>(byte ^ 1);
  const Replay result = replayed(messages);
  EXPECT_EQ(result.compared, 100);
  EXPECT_EQ(result.different, 1);
  ASSERT_TRUE(result.first);
  EXPECT_EQ(result.first->tick, 37);
  EXPECT_EQ(result.first->joint, 0);
  EXPECT_EQ(result.first->ulps, 1U);
  EXPECT_NE(result.first->recorded, result.first->replayed);
  EXPECT_EQ(result.joints[0].peak_tick, 37);
  EXPECT_EQ(result.joints[1].difference.peak(), 0);
}

TEST_F(ReplayTest, StopsAtATickWithoutMeasurementOrReference) {
  const auto whole = support::in_process_log(support::shortened("practical_rigid.yaml", "0.05"));
  for (const auto& [piece, channel] :
       {std::pair{measurement, "ARM_POSITION"}, std::pair{reference, "ARM_REFERENCE"}}) {
    auto messages = whole;
    messages.erase(messages.begin() + static_cast<std::ptrdiff_t>(index_of(20, piece)));
    const Replay result = replayed(messages);
    EXPECT_EQ(result.compared, 20);
    EXPECT_EQ(result.last_compared, 19);
    EXPECT_EQ(result.different, 0);
    EXPECT_FALSE(result.complete());
    EXPECT_EQ(result.stopped_by, std::string("tick 20 has no ") + channel);
  }
}

TEST_F(ReplayTest, StepsThroughATickWithoutCommandAndSaysSo) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.05"));
  messages.erase(messages.begin() + static_cast<std::ptrdiff_t>(index_of(20, command)));
  const Replay result = replayed(messages);
  EXPECT_EQ(result.compared, 49);
  EXPECT_EQ(result.different, 0);
  EXPECT_EQ(result.without_command, 1U);
  EXPECT_EQ(result.first_without_command, 20);
  EXPECT_FALSE(result.complete());
}

TEST_F(ReplayTest, ARunThatWasEndedBetweenTwoMessagesHasNoGap) {
  const auto whole = support::in_process_log(support::shortened("practical_rigid.yaml", "0.05"));
  for (const int piece : {0, measurement, reference, command, 4, 5}) {
    auto messages = whole;
    messages.resize(index_of(30, piece));
    const Replay result = replayed(messages);
    EXPECT_EQ(result.compared, piece > command ? 31 : 30);
    EXPECT_TRUE(result.complete()) << result.stopped_by;
  }
}

TEST_F(ReplayTest, ReadsALogInOrderOfArrivalWithCopies) {
  auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.2"));
  // RUN_INFO comes late, messages are out of order by up to ten ticks, and every seventh comes
  // twice.
  std::mt19937_64 random(3);
  std::vector<std::pair<std::size_t, Recorded>> arrivals;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    arrivals.emplace_back(i == 0 ? 500 : i + random() % 60, messages[i]);
    if (i % 7 == 0) arrivals.emplace_back(i + random() % 60, messages[i]);
  }
  std::stable_sort(arrivals.begin(), arrivals.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Recorded> shuffled;
  for (const auto& [at, message] : arrivals) shuffled.push_back(message);
  const Replay result = replayed(shuffled);
  EXPECT_EQ(result.compared, 200);
  EXPECT_EQ(result.different, 0);
  EXPECT_TRUE(result.complete());
}

TEST_F(ReplayTest, AnotherGainGivesTheDifferenceThatTheLawSays) {
  const auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.05"));
  logger::RunLog log = open(messages);
  const scenario::Scenario other =
      scenario::parse_scenario(log.info().scenario, log.info().robot_description, "log",
                               {"controller.gains.kp=[30000, 2400]"});
  std::vector<double> differences;
  const Replay result = replay(log, other, controller::scenario_law(other),
                               [&](std::int64_t, const Vector& recorded, const auto& computed) {
                                 differences.push_back(computed[0] - recorded[0]);
                               });
  EXPECT_EQ(result.compared, 50);
  EXPECT_EQ(result.joints[1].difference.peak(), 0);
  log.rewind();
  logger::TickRecord record;
  double largest = 0;
  for (std::size_t k = 0; log.next(record); ++k) {
    const double e = std::get<messages::PositionMeasurement>(*record.measurement).q[0] -
                     record.reference->q_ref[0];
    // Torques of up to 1e3 N m with a few roundings: 1e3 * 2.2e-16 * 10.
    EXPECT_NEAR(differences[k], 10000 * e, 3e-12);
    largest = std::max(largest, std::abs(10000 * e));
  }
  EXPECT_NEAR(result.joints[0].difference.peak(), largest, 3e-12);
}

TEST_F(ReplayTest, ALawMayMeasureLessThanWasMeasured) {
  const auto messages =
      support::in_process_log(support::shortened("practical_flexible.yaml", "0.02"));
  logger::RunLog log = open(messages);
  const auto under = [&](const std::string& law, const std::string& gains) {
    return scenario::parse_scenario(log.info().scenario, log.info().robot_description, "log",
                                    {"controller.law=" + law, "controller.gains={" + gains + "}"});
  };
  const auto rigid = under("loria_ortega_rigid", "kp: 100, kd: 10, a: 100, b: 100");
  EXPECT_EQ(replay(log, rigid, controller::scenario_law(rigid)).compared, 20);
  try {
    const auto of_states = under("slotine_li", "lambda: 9, ks: 9");
    replay(log, of_states, controller::scenario_law(of_states));
    FAIL() << "a state law was fed from LINK_STATE";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("slotine_li needs the measurement STATE"));
    EXPECT_THAT(failure.what(), HasSubstr("LINK_STATE"));
  }
}

TEST_F(ReplayTest, RefusesASamplePeriodThatWasNotRecorded) {
  const auto messages = support::in_process_log(support::shortened("practical_rigid.yaml", "0.02"));
  logger::RunLog log = open(messages);
  const scenario::Scenario other = scenario::parse_scenario(
      log.info().scenario, log.info().robot_description, "log", {"loop.period_s=0.002"});
  EXPECT_THROW(replay(log, other, controller::scenario_law(other)), base::Failure);
}

TEST(Ulps, CountDoublesBetweenTwo) {
  EXPECT_EQ(ulps_between(1, 1), 0U);
  EXPECT_EQ(ulps_between(1, std::nextafter(1, 2)), 1U);
  EXPECT_EQ(ulps_between(std::nextafter(-1, -2), -1), 1U);
  EXPECT_EQ(ulps_between(0.0, -0.0), 1U) << "their bits differ";
  EXPECT_EQ(ulps_between(-5e-324, 5e-324), 3U);
  EXPECT_EQ(ulps_between(1, 2), std::uint64_t{1} << 52);
}

}  // namespace
}  // namespace tachless::replay
