#include "report/summary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>

namespace tachless::report {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

Vector vector(std::initializer_list<double> values) {
  Vector v(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), v.data());
  return v;
}

study::Tracking two_ticks() {
  study::Tracking tracking(2);
  tracking.add(0, vector({0.5, 0}), vector({0, 0}), {}, vector({3, 0}));
  tracking.add(0.25, vector({-0.25, 0}), vector({0, 0}), {}, vector({-4, 0}));
  return tracking;
}

scenario::Scenario scenario() {
  scenario::Scenario scenario;
  scenario.name = "paper_rigid";
  scenario.controller.law = "loria_ortega_rigid";
  scenario.loop.period_s = 0.25;
  scenario.loop.num_ticks = 2;
  return scenario;
}

RunFacts facts() {
  RunFacts facts;
  facts.run_id = 7;
  facts.wall_s = 9;
  facts.log_path = "out/lcmlog";
  facts.log_ticks = 2;
  return facts;
}

using std::chrono::microseconds;

const robot::JointLabels two_rotary = {{"shoulder", "elbow"}, {"rad", "rad"}, {"N m", "N m"}};

std::vector<session::Statistics> counters() {
  session::Statistics plant(messages::Role::plant);
  plant.wall_s = 0.125;
  plant.ticks = 2;
  plant.resends = 3;
  plant.duplicates = 1;
  plant.rejected.add(messages::Rejection::wrong_size);
  plant.rejected.add(messages::Rejection::wrong_size);
  session::PlantStatistics& own = plant.plant();
  own.round_trip_us.add(microseconds(80));
  own.command_age_us.add(microseconds(50));
  own.missed_deadlines = 4;
  own.longest_miss = 2;
  own.missed_commands = 7;
  own.longest_command_miss = 6;
  own.late_commands = 5;
  own.missed_readings = 11;
  own.longest_reading_miss = 10;
  own.driver = {{"frames_lost", 12}};
  own.saturated_ticks = {0, 9};
  own.beyond_limit_ticks = {3, 0};
  session::Statistics controller(messages::Role::controller);
  controller.resends = 1;
  controller.controller().skipped_ticks = 8;
  controller.rejected.add(messages::Rejection::wrong_size);
  controller.rejected.add(session::Discard::too_old, 5);
  return {plant, controller};
}

nlohmann::ordered_json summarise(const RunFacts& facts, const study::Tracking& tracking,
                                 const std::vector<session::Statistics>& statistics) {
  return to_json(RunSummary{scenario(), facts, tracking, statistics}, two_rotary);
}

TEST(Summary, HasExactlyTheDocumentedKeysInTheirOrder) {
  const nlohmann::ordered_json summary = summarise(facts(), two_ticks(), counters());
  std::vector<std::string> keys;
  for (const auto& [key, value] : summary.items()) keys.push_back(key);
  EXPECT_THAT(
      keys, ElementsAre(
                "scenario", "run_id", "mode", "law", "joints", "ticks", "period_s", "duration_s",
                "wall_s", "ticks_per_s", "real_time_factor", "placement", "predicted",
                "position_error_rad", "torque_Nm", "round_trip_us", "resends", "duplicates",
                "rejected", "missed_deadlines", "longest_miss", "missed_commands",
                "longest_command_miss", "late_commands", "missed_readings", "longest_reading_miss",
                "skipped_ticks", "wake_up_jitter_us", "command_age_us", "saturated_ticks",
                "beyond_limit_ticks", "robot_is_clock", "driver", "log", "contact", "robot_stopped",
                "dropped_output_bytes", "hidden_output_lines", "outcome", "verdict", "fault"));
}

// In one process what a tick costs is not counted, as it is not where the robot is the clock.
TEST(Summary, HasARobotThatIsTheClockOnlyWhereThePlantSaysSo) {
  for (const bool clock : {false, true}) {
    std::vector<session::Statistics> counted = counters();
    counted[0].plant().robot_is_clock = clock;
    EXPECT_EQ(summarise(facts(), two_ticks(), counted)["robot_is_clock"], clock);
  }
}

TEST(Summary, TakesErrorsAndTorquesFromTheSignals) {
  const nlohmann::ordered_json summary = summarise(facts(), two_ticks(), counters());
  EXPECT_EQ(summary["position_error_rad"]["peak"], (std::vector<double>{0.5, 0}));
  EXPECT_EQ(summary["position_error_rad"]["final"], (std::vector<double>{-0.25, 0}));
  EXPECT_EQ(summary["torque_Nm"]["peak"], (std::vector<double>{4, 0}));
  EXPECT_DOUBLE_EQ(summary["torque_Nm"]["rms"][0].get<double>(), std::sqrt(12.5));
  EXPECT_EQ(summary["joints"], (std::vector<std::string>{"shoulder", "elbow"}));
  EXPECT_EQ(summary["ticks"], 2);
  EXPECT_EQ(summary["duration_s"], 0.5);
}

TEST(Summary, AddsUpTheProcessesCounters) {
  const nlohmann::ordered_json summary = summarise(facts(), two_ticks(), counters());
  EXPECT_EQ(summary["resends"], 4);
  EXPECT_EQ(summary["duplicates"], 1);
  EXPECT_EQ(summary["rejected"]["too_old"], 5);
  EXPECT_EQ(summary["rejected"]["wrong_size"], 3);
  EXPECT_EQ(summary["rejected"]["other_run"], 0) << "every reason is listed";
  const session::LatencyHistogram round_trip = counters()[0].plant().round_trip_us;
  EXPECT_EQ(summary["round_trip_us"]["p50"], round_trip.percentile_us(0.5));
  EXPECT_EQ(summary["round_trip_us"]["max"], 80);
  EXPECT_EQ(summary["round_trip_us"]["histogram"][0][1], 1);
  EXPECT_EQ(summary["missed_deadlines"], 4);
  EXPECT_EQ(summary["longest_miss"], 2);
  EXPECT_EQ(summary["missed_commands"], 7);
  EXPECT_EQ(summary["longest_command_miss"], 6);
  EXPECT_EQ(summary["late_commands"], 5);
  EXPECT_EQ(summary["missed_readings"], 11);
  EXPECT_EQ(summary["longest_reading_miss"], 10);
  EXPECT_EQ(summary["driver"]["frames_lost"], 12);
  EXPECT_EQ(summary["skipped_ticks"], 8);
  EXPECT_EQ(summary["saturated_ticks"], (std::vector<int>{0, 9}));
  EXPECT_EQ(summary["beyond_limit_ticks"], (std::vector<int>{3, 0}));
  EXPECT_EQ(summary["command_age_us"]["max"], 50);
  EXPECT_TRUE(summary["wake_up_jitter_us"]["p50"].is_null()) << "nothing was measured";
  EXPECT_EQ(summary["wall_s"], 0.125);
  EXPECT_EQ(summary["ticks_per_s"], 16);
  EXPECT_EQ(summary["real_time_factor"], 4);
  EXPECT_TRUE(summary["fault"].is_null());
}

TEST(Summary, OfARunThatNeverBeganSaysSo) {
  RunFacts failed = facts();
  failed.fault = "plant was killed by signal 9 (Killed)";
  failed.log_ticks = 0;
  const RunSummary run{scenario(), failed, study::Tracking(2), {}};
  const nlohmann::ordered_json summary = to_json(run, two_rotary);
  EXPECT_EQ(summary["fault"], "plant was killed by signal 9 (Killed)");
  EXPECT_EQ(summary["ticks"], 0);
  EXPECT_TRUE(summary["position_error_rad"]["peak"].empty());
  EXPECT_TRUE(summary["round_trip_us"]["p50"].is_null());
  EXPECT_EQ(summary["wall_s"], 9);
  EXPECT_THAT(closing_table(run, two_rotary), HasSubstr("0 of 2 ticks"));
}

TEST(Summary, TableShowsEveryJointWithItsUnits) {
  const std::string table = closing_table({scenario(), facts(), two_ticks(), counters()},
                                          {{"turn", "slide"}, {"rad", "m"}, {"N m", "N"}});
  EXPECT_THAT(table, HasSubstr("  1 turn        5.000e-01"));
  EXPECT_THAT(table, HasSubstr("\n  2 slide  "));
  EXPECT_THAT(table, HasSubstr("-2.500e-01  rad"));
  EXPECT_THAT(table, HasSubstr("0  N\n"));
  EXPECT_THAT(table, HasSubstr("16 ticks/s"));
  EXPECT_THAT(table, HasSubstr("log gaps 0, resends 4, datagrams rejected 8"));
  EXPECT_THAT(table, Not(HasSubstr("missed deadlines")));
}

TEST(Summary, TableOfARealtimeRunShowsMissedDeadlines) {
  scenario::Scenario realtime = scenario();
  realtime.loop.mode = scenario::Mode::realtime;
  const std::string table = closing_table({realtime, facts(), two_ticks(), counters()}, two_rotary);
  EXPECT_THAT(table, HasSubstr("missed deadlines 4 (longest run of them 2)"));
  EXPECT_THAT(table, HasSubstr("missed commands 7 (longest run of them 6)"));
  EXPECT_THAT(table, HasSubstr("command age    50 µs (median)"));
  EXPECT_THAT(table, HasSubstr("joint 2 (elbow) at its torque limit in 9 ticks"));
  EXPECT_THAT(table, HasSubstr("joint 1 (shoulder) beyond its range or its speed in 3 ticks"));
}

}  // namespace
}  // namespace tachless::report
