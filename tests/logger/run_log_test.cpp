#include "logger/run_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "base/failure.h"
#include "base/version.h"
#include "bus/authenticated.h"
#include "tests/support/damaged_log.h"
#include "tests/support/recorded_run.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

using testing::HasSubstr;

/// Compares bit for bit, because encoder and decoder do not compute.
void expect_equal(const Vector& a, const Vector& b) {
  ASSERT_EQ(a.size(), b.size());
  for (Eigen::Index i = 0; i < a.size(); ++i) EXPECT_EQ(a(i), b(i));
}

void expect_equal(const TickRecord& a, const TickRecord& b) {
  EXPECT_EQ(a.tick, b.tick);
  for (const Slot piece : messages::all_slots) ASSERT_EQ(has(a, piece), has(b, piece)) << a.tick;
  if (a.reference) {
    expect_equal(a.reference->q_ref, b.reference->q_ref);
    expect_equal(a.reference->snap_ref, b.reference->snap_ref);
  }
  if (a.command) expect_equal(a.command->tau, b.command->tau);
  if (a.controller_state) {
    EXPECT_EQ(a.controller_state->num, b.controller_state->num);
    for (std::size_t i = 0; i < messages::max_signals; ++i) {
      expect_equal(a.controller_state->value[i], b.controller_state->value[i]);
    }
  }
  if (a.truth) {
    expect_equal(a.truth->q, b.truth->q);
    expect_equal(a.truth->thetadot, b.truth->thetadot);
    EXPECT_EQ(a.truth->saturated, b.truth->saturated);
    EXPECT_EQ(a.truth->fault, b.truth->fault);
  }
  ASSERT_EQ(a.measurement.has_value(), b.measurement.has_value());
  if (!a.measurement) return;
  EXPECT_EQ(a.measurement->index(), b.measurement->index());
  if (const auto* x = std::get_if<messages::PositionMeasurement>(&*a.measurement)) {
    expect_equal(x->q, std::get<messages::PositionMeasurement>(*b.measurement).q);
  }
  if (const auto* x = std::get_if<messages::LinkStateMeasurement>(&*a.measurement)) {
    expect_equal(x->theta, std::get<messages::LinkStateMeasurement>(*b.measurement).theta);
  }
}

class RunLogTest : public testing::Test {
 protected:
  RunLog open(const std::vector<Recorded>& messages) {
    write_file(path_, log_of(messages));
    return RunLog::open(path_);
  }

  static std::vector<TickRecord> read_all(RunLog& log) {
    std::vector<TickRecord> ticks;
    TickRecord record;
    while (log.next(record)) ticks.push_back(record);
    return ticks;
  }

  static void expect_whole(RunLog& log, const RecordedRun& run) {
    const auto ticks = read_all(log);
    ASSERT_EQ(ticks.size(), run.ticks.size());
    for (std::size_t i = 0; i < ticks.size(); ++i) expect_equal(ticks[i], run.ticks[i]);
    EXPECT_EQ(log.summary().gaps(), 0u);
    EXPECT_TRUE(log.summary().undecodable.empty());
    EXPECT_EQ(log.summary().wrong_tick, 0u);
    EXPECT_EQ(log.summary().too_late, 0u);
  }

  std::string failure_of(const std::vector<Recorded>& messages) {
    write_file(path_, log_of(messages));
    return failure_of_file();
  }

  std::string failure_of_file() {
    try {
      RunLog::open(path_);
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      return failure.what();
    }
    return "no failure";
  }

  TemporaryDirectory directory_;
  std::filesystem::path path_ = directory_.path() / "lcmlog";
};

TEST_F(RunLogTest, ReadsACanonicalLogTickByTick) {
  const auto run = short_rigid_run();
  auto log = open(run.messages);
  EXPECT_EQ(log.run(), 7);
  EXPECT_EQ(log.scenario().name, "paper_rigid");
  EXPECT_EQ(log.description().layout.num_joints, 2);
  EXPECT_EQ(log.description().layout.num_motors, 0);
  EXPECT_EQ(log.description().layout.num_signals, 2);
  expect_whole(log, run);
  EXPECT_EQ(log.summary().of(Slot::command).channel, "ARM_COMMAND");
  EXPECT_EQ(log.summary().last_tick, 39);
  log.rewind();
  expect_whole(log, run);
}

TEST_F(RunLogTest, ReadsAFlexibleRobotsLog) {
  const auto run = short_flexible_run();
  auto log = open(run.messages);
  EXPECT_EQ(log.description().layout.num_motors, 2);
  EXPECT_EQ(log.description().layout.num_signals, 4);
  expect_whole(log, run);
}

TEST_F(RunLogTest, PutsMessagesThatArrivedInDisorderInOrder) {
  const auto run =
      recorded_run("paper_rigid.yaml", {"loop.duration_s=0.1"}, "POSITION");  // 2000 ticks
  auto messages = run.messages;
  std::mt19937_64 random(2);
  // RUN_INFO is last. Other messages are up to 300 messages (50 ticks) from their place. A tenth of
  // them is doubled, and heartbeats lie between them.
  std::rotate(messages.begin(), messages.begin() + 1, messages.end());
  std::vector<std::pair<std::size_t, Recorded>> places;
  std::uint64_t copies = 0;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    places.emplace_back(i + random() % 300, messages[i]);
    if (i + 1 < messages.size() && random() % 10 == 0) {
      places.emplace_back(i + random() % 300, messages[i]);
      ++copies;
    }
    if (i % 100 == 0) places.emplace_back(i, fault_message(run, "encoder lost"));
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  messages.clear();
  for (auto& [place, message] : places) messages.push_back(message);
  auto log = open(messages);
  expect_whole(log, run);
  std::uint64_t duplicates = 0;
  for (const auto& piece : log.summary().pieces) {
    duplicates += piece.duplicates;
    EXPECT_EQ(piece.conflicts, 0u);
  }
  EXPECT_EQ(duplicates, copies);
  ASSERT_EQ(log.summary().faults.size(), 1u);
  EXPECT_EQ(log.summary().faults[0].text, "encoder lost");
  EXPECT_EQ(log.summary().faults[0].role, messages::Role::controller);
  EXPECT_EQ(log.summary().faults[0].tick, 17);
}

TEST_F(RunLogTest, NamesGapsAndDoesNotBridgeThem) {
  const auto run = short_rigid_run();
  auto messages = run.messages;
  // Removes COMMAND of ticks 5, 6 and 20, everything of ticks 30 to 34, and TRUTH of the last tick.
  std::erase_if(messages, [&](const Recorded& message) {
    if (message.channel == "ARM_RUN_INFO") return false;
    const auto tick = message.utime / 50;
    return (message.channel == "ARM_COMMAND" && (tick == 5 || tick == 6 || tick == 20)) ||
           (tick >= 30 && tick < 35) || (message.channel == "ARM_TRUTH" && tick == 39);
  });
  auto log = open(messages);
  const auto ticks = read_all(log);
  EXPECT_EQ(ticks.size(), 35u);
  EXPECT_FALSE(ticks[5].command);
  EXPECT_TRUE(ticks[5].truth);
  const auto& command = log.summary().of(Slot::command);
  EXPECT_EQ(command.missing.count, 8u);
  ASSERT_EQ(command.missing.listed.size(), 3u);
  EXPECT_EQ(command.missing.listed[0].first, 5);
  EXPECT_EQ(command.missing.listed[0].last, 6);
  EXPECT_EQ(command.missing.listed[2].first, 30);
  EXPECT_EQ(command.missing.listed[2].last, 34);
  EXPECT_EQ(log.summary().of(Slot::truth).missing.count, 6u);
  EXPECT_EQ(log.summary().gaps(), 6u * 5 + 3 + 1);
}

TEST_F(RunLogTest, TheReferenceOfATickThatNeverBeganIsNoGap) {
  const auto run = short_rigid_run();
  auto messages = run.messages;
  // The log ends after tick 19. The reference had already sent tick 20, because it is a tick ahead.
  std::erase_if(messages, [&](const Recorded& message) {
    if (message.channel == "ARM_RUN_INFO") return false;
    const auto tick = message.utime / 50;
    return tick > 20 || (tick == 20 && message.channel != "ARM_REFERENCE");
  });
  auto log = open(messages);
  for (int time = 0; time < 2; ++time, log.rewind()) {
    EXPECT_EQ(read_all(log).size(), 20u);
    EXPECT_EQ(log.summary().last_tick, 19);
    EXPECT_EQ(log.summary().gaps(), 0u);
  }
  // A tick with missing messages in the middle is a gap, even when only its reference is left.
  std::erase_if(messages, [&](const Recorded& message) {
    return message.utime / 50 == 10 && message.channel != "ARM_RUN_INFO" &&
           message.channel != "ARM_REFERENCE";
  });
  auto holed = open(messages);
  EXPECT_EQ(read_all(holed).size(), 20u);
  EXPECT_EQ(holed.summary().gaps(), 5u);
}

TEST_F(RunLogTest, TicksOfARealtimeRunsStopAreNoGaps) {
  auto run =
      recorded_run("paper_rigid.yaml", {"loop.duration_s=0.1", "loop.mode=realtime"}, "POSITION");
  auto messages = run.messages;
  messages.resize(1 + 6 * 600);
  // From tick 500 on the plant alone goes on. The command of tick 300 was lost.
  std::erase_if(messages, [](const Recorded& message) {
    const auto tick = message.utime / 50;
    const bool of_others = message.channel == "ARM_COMMAND" || message.channel == "ARM_REFERENCE";
    return (of_others && tick >= 500) || (message.channel == "ARM_COMMAND" && tick == 300);
  });
  auto silent = open(messages);
  read_all(silent);
  EXPECT_GT(silent.summary().gaps(), 100U);
  run.stop_tick = 499;
  messages.insert(messages.begin() + 1 + 6 * 500, fault_message(run, "interrupted"));
  auto log = open(messages);
  read_all(log);
  EXPECT_EQ(log.summary().gaps(), 1U);
  EXPECT_EQ(log.summary().last_tick, 599);
  EXPECT_EQ(log.summary().stop_reason(2000), "interrupted");
}

TEST_F(RunLogTest, SaysHowTheRunEnded) {
  const auto run = short_rigid_run();
  const auto reason_of = [&](const std::vector<Recorded>& messages) {
    auto log = open(messages);
    read_all(log);
    return log.summary().stop_reason(40);
  };
  auto cut = run.messages;
  cut.resize(1 + 6 * 30);
  EXPECT_EQ(reason_of(run.messages), "");
  EXPECT_EQ(reason_of(cut), "the log ends after 30 of 40 ticks and does not say why");
  auto finished = cut;
  finished.push_back(finished_message(run));
  EXPECT_EQ(reason_of(finished), "") << "a realtime log may lack its last ticks";
  auto stopped = cut;
  stopped.push_back(fault_message(run, "encoder lost"));
  stopped.push_back(fault_message(run, "interrupted"));
  EXPECT_EQ(reason_of(stopped), "encoder lost");
  stopped.push_back(finished_message(run));
  EXPECT_EQ(reason_of(stopped), "encoder lost");
  // A fault of a process that another has replaced before the run.
  auto replaced = run;
  replaced.stop_tick = -1;
  finished.insert(finished.begin() + 1, fault_message(replaced, "no such law"));
  EXPECT_EQ(reason_of(finished), "");
  // A fault of a process that has joined no run.
  replaced.run = 0;
  cut.push_back(fault_message(replaced, "there is already a controller"));
  EXPECT_EQ(reason_of(cut), "the log ends after 30 of 40 ticks and does not say why");
}

TEST_F(RunLogTest, TheLaunchersWordIsTheCause) {
  auto run = short_rigid_run();
  run.messages.resize(1 + 6 * 30);
  run.messages.push_back(fault_message(run, "interrupted"));
  write_file(path_, run.bytes());
  append_cause(path_, run.scenario, run.run,
               {messages::Role::controller, 29, "controller was killed\nby signal 9"},
               base::ExitCode::peer_lost);
  auto log = RunLog::open(path_);
  std::vector<LogEvent> events;
  log.watch([&](const LogEvent& event) { events.push_back(event); });
  read_all(log);
  EXPECT_FALSE(log.damage().any());
  EXPECT_EQ(log.damage().numbers_restarted, 0U);
  EXPECT_EQ(events.back().number, 1 + 6 * 30 + 1);
  EXPECT_EQ(events.back().utime, events[events.size() - 2].utime);
  EXPECT_EQ(log.summary().stop_reason(40), "controller was killed?by signal 9");
  EXPECT_EQ(log.summary().faults.size(), 2U);
}

TEST_F(RunLogTest, SaysWhichPieceWasNeverRecorded) {
  auto messages = short_rigid_run().messages;
  std::erase_if(messages, [](const Recorded& message) { return message.channel == "ARM_TRUTH"; });
  auto log = open(messages);
  EXPECT_EQ(read_all(log).size(), 40u);
  EXPECT_TRUE(log.summary().of(Slot::truth).absent());
  EXPECT_EQ(log.summary().gaps(), 0u);
}

TEST_F(RunLogTest, FindsTheRestAfterALongGap) {
  const auto run = recorded_run("paper_rigid.yaml", {"loop.duration_s=0.1"}, "POSITION");
  auto messages = run.messages;
  messages.erase(messages.begin() + 1 + 6 * 100, messages.begin() + 1 + 6 * 1500);
  auto log = open(messages);
  const auto ticks = read_all(log);
  ASSERT_EQ(ticks.size(), 600u);
  EXPECT_EQ(ticks[100].tick, 1500);
  expect_equal(ticks[100], run.ticks[1500]);
  EXPECT_EQ(log.summary().gaps(), 6u * 1400);
  EXPECT_EQ(log.summary().too_late, 0u);
}

TEST_F(RunLogTest, ADamagedTickNumberDoesNotCostTheTicksThatFollow) {
  for (const bool realtime : {false, true}) {
    auto overrides = std::vector<std::string>{"loop.duration_s=0.1"};
    if (realtime) overrides.push_back("loop.mode=realtime");
    auto damaged = recorded_run("paper_rigid.yaml", overrides, "POSITION");
    // The position of tick 100 (second of its tick) states tick 1892, because a byte is flipped.
    auto& data = damaged.messages[1 + 6 * 100 + 1].data;
    data[8 + 8 + 8 + 6] = static_cast<char>(data[8 + 8 + 8 + 6] ^ 0x07);
    auto log = open(damaged.messages);
    const auto ticks = read_all(log);
    ASSERT_EQ(ticks.size(), 2000u);
    EXPECT_EQ(log.summary().of(Slot::measurement).missing.count, 1u);
    EXPECT_EQ(log.summary().gaps(), 1u);
    EXPECT_EQ(log.summary().wrong_tick + log.summary().too_late +
                  log.summary().of(Slot::measurement).conflicts,
              1u);
  }
}

TEST_F(RunLogTest, CountsForeignRunsAndStrangers) {
  const auto run = short_rigid_run();
  const auto other =
      recorded_run("iiwa_point_to_point.yaml", {"loop.duration_s=0.01", "robot.name=arm"},
                   "POSITION", rigid_signals, 99);
  auto messages = run.messages;
  messages.insert(messages.begin() + 20, other.messages.begin(), other.messages.end());
  messages.push_back({0, "CAMERA", "not ours"});
  auto log = open(messages);
  expect_whole(log, run);
  EXPECT_EQ(log.summary().foreign_messages, other.messages.size());
  EXPECT_EQ(log.summary().foreign_runs.at(99), other.messages.size());
  auto chosen = RunLog::open(path_, 99);
  EXPECT_EQ(chosen.description().layout.num_joints, 7);
  expect_whole(chosen, other);
}

TEST_F(RunLogTest, CountsWhatCannotBeDecodedByReason) {
  auto messages = short_rigid_run().messages;
  messages[2].data.pop_back();                                         // POSITION of tick 0
  for (std::size_t i = 36; i < 44; ++i) messages[3].data[i] = '\xff';  // REFERENCE: NaN
  messages[4].data[0] ^= 1;                                            // COMMAND: fingerprint
  auto log = open(messages);
  read_all(log);
  const auto& undecodable = log.summary().undecodable;
  EXPECT_EQ(undecodable.at(messages::Rejection::wrong_size), 1u);
  EXPECT_EQ(undecodable.at(messages::Rejection::non_finite), 1u);
  EXPECT_EQ(undecodable.at(messages::Rejection::wrong_type), 1u);
  EXPECT_EQ(log.summary().gaps(), 3u);
}

TEST_F(RunLogTest, KeepsTheFirstOfTwoThatContradictEachOther) {
  const auto run = short_rigid_run();
  auto messages = run.messages;
  Recorded other = messages[4];
  other.data.back() = static_cast<char>(other.data.back() ^ 1);
  messages.insert(messages.begin() + 5, other);
  auto log = open(messages);
  expect_whole(log, run);
  EXPECT_EQ(log.summary().of(Slot::command).conflicts, 1u);
}

TEST_F(RunLogTest, UsesALaterRunInfoWhenTheFirstIsDamaged) {
  const auto run = short_rigid_run();
  auto messages = run.messages;
  messages.push_back(messages[0]);
  messages[0].data.resize(messages[0].data.size() / 2);
  auto log = open(messages);
  const auto ticks = read_all(log);
  EXPECT_EQ(ticks.size(), 40u);
}

TEST_F(RunLogTest, SaysWhyALogIsNoRun) {
  EXPECT_THAT(failure_of({}), testing::AllOf(HasSubstr(path_.string()),
                                             HasSubstr("the file is empty; name an LCM log")));
  write_file(path_, "robot.urdf\n");
  EXPECT_THAT(failure_of_file(), HasSubstr("not one message of an LCM log"));
  write_file(path_, "<robot name=\"arm\">");
  EXPECT_THAT(failure_of_file(), HasSubstr("this is a robot description; type: tachless robot /"));
  EXPECT_THAT(failure_of({{0, "CAMERA", "x"}}), HasSubstr("none of its 1 messages"));
  auto messages = short_rigid_run().messages;
  messages[0].data.pop_back();
  EXPECT_THAT(failure_of(messages), HasSubstr("at byte 0 is damaged"));
  messages = short_rigid_run().messages;
  messages[0].data += std::string(bus::tag_size, 'x');
  EXPECT_THAT(failure_of(messages), HasSubstr("or carries the tag of a key"));
  messages = short_rigid_run().messages;
  const std::string law = "law: ";
  const auto at = messages[0].data.find(law + "loria_ortega_rigid");
  messages[0].data.replace(at + law.size(), 5, "LORIA");
  EXPECT_THAT(failure_of(messages), HasSubstr("cannot be used"));
  messages = short_rigid_run().messages;
  messages[0].data[39] ^= 1;  // lowest byte of num_ticks
  EXPECT_THAT(failure_of(messages), HasSubstr("contradicts"));
}

/// A complete log of 8 ticks of paper_rigid, recorded by tachless 0.1.0.
constexpr const char* old_log = TACHLESS_SOURCE_DIR "/tests/logger/lcmlog_0.1.0";

TEST(LogOf_0_1_0, IsRefusedWithTheVersionThatReadsIt) {
  try {
    RunLog::open(old_log);
    FAIL() << "not refused";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(),
                HasSubstr("was recorded by tachless 0.1.0; this is " + std::string(base::version)));
    EXPECT_THAT(failure.what(), HasSubstr("use 0.1.0 to read it"));
  }
}

}  // namespace
}  // namespace tachless::logger
