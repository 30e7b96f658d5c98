// These tests have a logger that cannot write, or is killed. They check messages, log and run end.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <deque>
#include <filesystem>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "bus/udp_transport.h"
#include "logger/run_log.h"
#include "messages/truth/truth_wire.h"
#include "tests/support/private_network.h"
#include "tests/support/process_facts.h"
#include "tests/system/four_programs.h"
#include "tests/system/oversleep.h"
#include "tests/system/small_disk.h"

namespace tachless::logger_faults_test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using base::Clock;
using system_test::FourPrograms;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string practical_rigid = scenarios + "practical_rigid.yaml";

/// Returns the last tick whose truth is in the log. The log has everything before, undamaged. Only
/// the last event may be damaged, if the logger was killed within a write.
std::int64_t last_tick_of(const std::string& path, bool killed = false) {
  logger::RunLog log = logger::RunLog::open(path);
  logger::TickRecord record;
  std::int64_t last = -1;
  while (log.next(record)) {
    if (record.truth) last = record.tick;
  }
  const logger::Damage& damage = log.damage();
  if (killed && damage.stretches == 1) {
    EXPECT_EQ(damage.listed.at(0).offset + damage.listed.at(0).bytes, fs::file_size(path));
    EXPECT_EQ(damage.missing_numbers, 0U);
  } else {
    EXPECT_FALSE(damage.any());
  }
  // The log may end within a tick k: after its TICK, and before its TRUTH.
  EXPECT_LE(log.summary().last_tick - last, 1);
  EXPECT_LE(log.summary().of(messages::Slot::truth).missing.count, 1U);
  return last;
}

void expect_replays(const std::string& log, const TemporaryDirectory& directory) {
  Program replay("tachless", {"replay", log}, directory.path());
  EXPECT_EQ(replay.wait(), 0) << replay.errors();
}

/// A busy machine causes no protective stop with this setting: the tests are about the disk.
const std::string patient = "loop.max_missed=1000";

class AFullDisk : public ::testing::TestWithParam<std::string> {};

TEST_P(AFullDisk, EndsTheFourProgramsAndKeepsWhatHasRoom) {
  const SmallDisk disk(1'024);
  FourPrograms run("practical_rigid.yaml");
  run.settings = {"--set", "loop.duration_s=1000", "--set", "loop.mode=" + GetParam(), "--set",
                  patient};
  const std::string log = disk / "lcmlog";
  run.log = log;
  run.start_all();
  EXPECT_EQ(run["logger"].wait(), 2);
  const auto ended = Clock::now();
  for (const char* role : {"plant", "reference", "controller"}) {
    EXPECT_EQ(run[role].wait(), 3) << role << run[role].errors();
  }
  EXPECT_LT(Clock::now() - ended, 60s);
  EXPECT_THAT(
      run["logger"].errors(),
      AllOf(HasSubstr(log + ": cannot write the log: No space left on device"),
            HasSubstr("the first " + std::to_string(fs::file_size(log)) + " bytes are kept"),
            HasSubstr("free some space on that disk")));
  EXPECT_THAT(run["plant"].errors(), HasSubstr("ended because of the logger"));
  // The log takes all the disk's room. The last event had no room.
  EXPECT_GT(fs::file_size(log), 1'024U * 1'024 - 4'096);
  EXPECT_GT(last_tick_of(log), 1'000);
  expect_replays(log, run.directory());
}

TEST_P(AFullDisk, EndsTachlessRunAndKeepsWhatHasRoom) {
  const SmallDisk disk(1'024);
  const TemporaryDirectory directory;
  Program run("tachless",
              {"run", practical_rigid, "--quiet", "--duration", "1000", "--mode", GetParam(),
               "--set", patient, "--out", disk / "out"},
              directory.path());
  run.wait_for("cannot write the log");
  const auto told = Clock::now();
  // The four programs are there. The figures of the log are drawn after them.
  const auto are_there = [&] {
    return std::ranges::any_of(support::children_of(run.pid()), [](pid_t pid) {
      return support::program_of(pid).starts_with("tachless-");
    });
  };
  while (are_there()) std::this_thread::sleep_for(5ms);
  EXPECT_LT(Clock::now() - told, 60s);
  EXPECT_EQ(run.wait(), 2);
  EXPECT_THAT(run.errors(),
              AllOf(HasSubstr("tachless: logger: "), HasSubstr("No space left on device"),
                    HasSubstr("free some space")));
  const std::string log = disk / "out/lcmlog";
  EXPECT_GT(last_tick_of(log), 1'000);
  expect_replays(log, directory);
}

INSTANTIATE_TEST_SUITE_P(In, AFullDisk, ::testing::Values("lockstep", "realtime"),
                         [](const auto& mode) { return mode.param; });

/// The disk takes longer than the time to give up, and the logger is not lost meanwhile.
TEST(ASlowDisk, IsWaitedForAtTheEnd) {
  for (const char* mode : {"lockstep", "realtime"}) {
    const TemporaryDirectory directory;
    Program run(
        "env",
        {"LD_PRELOAD=" TACHLESS_SLOW_DISK, TACHLESS_BINARY_DIR "/bin/tachless", "run",
         practical_rigid, "--quiet", "--duration", "0.1", "--mode", mode, "--set", patient, "--set",
         "loop.max_missed_share=1", "--set", "loop.give_up_s=1", "--out", directory / "out"},
        directory.path());
    EXPECT_EQ(run.wait(), 0) << run.errors();
    EXPECT_FALSE(logger::RunLog::open(directory / "out/lcmlog").damage().any());
  }
}

TEST(ALimitOnFileSizes, EndsTheRunAndKeepsWhatItAllows) {
  const TemporaryDirectory directory;
  Program run("prlimit",
              {"--fsize=1000000", TACHLESS_BINARY_DIR "/bin/tachless", "run", practical_rigid,
               "--quiet", "--duration", "1000", "--out", directory / "out"},
              directory.path());
  EXPECT_EQ(run.wait(), 2);
  EXPECT_THAT(run.errors(), AllOf(HasSubstr("lcmlog: cannot write the log: File too large"),
                                  HasSubstr("ulimit -f")));
  EXPECT_GT(fs::file_size(directory / "out/lcmlog"), 1'000'000U - 4'096);
  EXPECT_GT(last_tick_of(directory / "out/lcmlog"), 1'000);
  expect_replays(directory / "out/lcmlog", directory);
}

TEST(ADirectoryThatCannotBeWritten, IsRefusedAtOnce) {
  SmallDisk disk(1'024);
  disk.make_read_only();
  const TemporaryDirectory directory;
  Program logger("tachless-logger", {practical_rigid, "--out-log", disk / "lcmlog"},
                 directory.path());
  EXPECT_EQ(logger.wait(), 2);
  EXPECT_THAT(logger.errors(), AllOf(HasSubstr(disk / "lcmlog"), HasSubstr("cannot create the log"),
                                     HasSubstr("Read-only file system"),
                                     HasSubstr("name a file in a directory you may write to")));
  Program run("tachless", {"run", practical_rigid, "--quiet", "--out", disk / "out"},
              directory.path());
  EXPECT_EQ(run.wait(), 2);
  EXPECT_THAT(run.errors(),
              AllOf(HasSubstr("--out " + (disk / "out")), HasSubstr("choose another directory")));
}

TEST(AKilledLogger, LosesAtMostTheLastHundredMillisecondsOnTheWallClock) {
  constexpr auto promised = 100ms;
  FourPrograms run("practical_rigid.yaml");
  run.settings = {"--set", "loop.duration_s=1000", "--set", "loop.mode=realtime", "--set", patient};
  bus::UdpTransport bus;
  bus.subscribe("ARM_TRUTH");
  run.start_all();
  const Oversleep oversleep;
  const messages::Codec<messages::truth::PlantTruth> codec(
      {.num_joints = 2, .num_motors = 0, .num_signals = 0});
  std::deque<std::pair<std::int64_t, Clock::time_point>> heard;  // tick, when
  while (heard.empty() || heard.back().first < 1'234) {
    const auto datagram = bus.receive(Clock::now() + 30s);
    ASSERT_TRUE(datagram) << run["plant"].errors();
    messages::Stamp stamp;
    messages::truth::PlantTruth truth;
    ASSERT_EQ(codec.decode(datagram->payload, stamp, truth), messages::Rejection::none);
    heard.emplace_back(stamp.tick, Clock::now());
  }
  const auto killed = Clock::now();
  run["logger"].signal(SIGKILL);
  EXPECT_EQ(run["logger"].wait(), 128 + SIGKILL);
  run["plant"].signal(SIGINT);
  for (const char* role : {"plant", "reference", "controller"}) run[role].wait();

  // The logger stood still whenever the machine did.
  const auto due = killed - promised - oversleep.longest();
  while (!heard.empty() && heard.back().second > due) heard.pop_back();
  ASSERT_FALSE(heard.empty()) << "stood still for "
                              << std::chrono::duration<double>(oversleep.longest()).count() << " s";
  EXPECT_GE(last_tick_of(run.log_path(), true), heard.back().first)
      << "of truth that was sent longer ago than promised, something is lost";
}

}  // namespace
}  // namespace tachless::logger_faults_test
