#include "process/child.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "diagnostics/failure.h"

namespace tachless::process {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;

std::vector<std::string> shell(const std::string& script) { return {"sh", "-c", script}; }

TEST(Child, RunKeepsLinesAndExitCode) {
  const Finished finished = run(shell("echo one; echo two >&2; printf end; exit 4"));
  EXPECT_THAT(finished.lines, ElementsAre("one", "two", "end"));
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_FALSE(finished.well());
  EXPECT_TRUE(run(shell("true")).well());
}

TEST(Child, RunTellsOfASignal) {
  const Finished finished = run(shell("kill -9 $$"));
  EXPECT_EQ(finished.signal, SIGKILL);
  EXPECT_FALSE(finished.well());
}

TEST(Child, RunWaitsForAProgramThatClosedItsOutput) {
  EXPECT_EQ(run(shell("exec >&- 2>&-; sleep 0.05; exit 3")).exit_code, 3);
}

TEST(Child, ReadsNothingFromTheTerminal) {
  EXPECT_THAT(run(shell("read line; echo $?")).lines, ElementsAre("1"));
}

TEST(Child, ThatCannotBeStartedIsNamed) {
  try {
    run({"no-such-program"});
    FAIL();
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("cannot start no-such-program: No such file"));
  }
  try {
    become({"/no/such/program"}, "build it");
  } catch (const diagnostics::Failure& failure) {
    EXPECT_STREQ(failure.what(),
                 "cannot start /no/such/program: No such file or directory; build it");
  }
}

TEST(Child, ACopyOfThisProcessTriesInItsPlace) {
  static int value = 0;
  EXPECT_TRUE(works_in_a_copy([] { return ++value == 1; }));
  EXPECT_EQ(value, 0);
  EXPECT_FALSE(works_in_a_copy([] { return false; }));
}

class Companions : public ::testing::Test {
 protected:
  SideProcess::OnLine listen() {
    return [this](std::string_view line) { lines_.emplace_back(line); };
  }

  static void wait_for_end(SideProcess& companion) {
    const auto deadline = Clock::now() + seconds(30);
    while (companion.running() && Clock::now() < deadline) {
      companion.attend();
      std::this_thread::sleep_for(milliseconds(5));
    }
    EXPECT_FALSE(companion.running());
  }

  std::string refusal(const std::string& script, milliseconds limit) {
    try {
      const SideProcess companion("window", shell(script), "ready", limit, listen());
    } catch (const diagnostics::Failure& failure) {
      EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
      return failure.what();
    }
    return "none";
  }

  std::vector<std::string> lines_;
};

TEST_F(Companions, IsThereOnceItHasSaidSo) {
  SideProcess companion("window",
                        shell("echo hello; echo ready; sleep 0.1; echo more >&2; printf end"),
                        "ready", seconds(30), listen());
  EXPECT_TRUE(companion.running());
  wait_for_end(companion);
  EXPECT_EQ(companion.trouble(), "");
  EXPECT_THAT(lines_, ElementsAre("more", "end"));
}

TEST_F(Companions, RefusesWithTheLastWordsOfOneThatIsNeverReady) {
  EXPECT_EQ(refusal("echo one; echo no display >&2; exit 2", seconds(30)), "no display");
  EXPECT_EQ(refusal("exit 7", seconds(30)), "window ended with exit code 7");
  EXPECT_EQ(refusal("exec sleep 100", seconds(1)), "window was not ready within 1 s");
}

TEST_F(Companions, TellsHowItEnded) {
  SideProcess failed("window", shell("echo ready; exit 3"), "ready", seconds(30), listen());
  wait_for_end(failed);
  EXPECT_EQ(failed.trouble(), "window ended with exit code 3");
  SideProcess killed("window", shell("echo ready; exec sleep 100"), "ready", seconds(30), listen());
  killed.signal(SIGKILL);
  wait_for_end(killed);
  EXPECT_THAT(killed.trouble(), HasSubstr("window was killed by signal 9"));
}

/// Whether there is no such process, or it only waits for init to notice its end.
bool gone(const std::string& pid) {
  std::ifstream stat("/proc/" + pid + "/stat");
  std::string number, name, state;
  return !(stat >> number >> name >> state) || state == "Z";
}

TEST_F(Companions, TakesWhatItHasStartedAlong) {
  for (const bool crashes : {false, true}) {
    lines_.clear();
    // Neither listens to SIGTERM.
    SideProcess companion("window", shell("trap '' TERM; echo ready; sleep 100 & echo $!; wait"),
                          "ready", seconds(30), listen());
    const auto deadline = Clock::now() + seconds(30);
    while (lines_.empty() && Clock::now() < deadline) companion.attend();
    ASSERT_EQ(lines_.size(), 1U);
    EXPECT_FALSE(gone(lines_[0]));
    if (crashes) {
      companion.signal(SIGKILL);
      wait_for_end(companion);
    } else {
      companion.stop();
      EXPECT_FALSE(companion.running());
    }
    while (!gone(lines_[0]) && Clock::now() < deadline) std::this_thread::yield();
    EXPECT_TRUE(gone(lines_[0])) << "crashes: " << crashes;
  }
}

TEST(EndWithin, KillsAProcessThatHasClosedItsOutputAndStays) {
  Child child = start(shell("exec >&- 2>&-; trap '' TERM; while :; do sleep 1; done"));
  const auto begin = Clock::now();
  EXPECT_EQ(end_within(child, std::chrono::milliseconds(50), [](const std::string&) {}).signal,
            SIGKILL);
  EXPECT_LT(Clock::now() - begin, seconds(30));
  EXPECT_FALSE(child.running);
}

TEST(EndWithin, ReturnsTheExitCodeAndTheLastLines) {
  std::vector<std::string> lines;
  Child child = start(shell("echo last; exit 5"));
  const End end = end_within(child, seconds(30), [&](std::string line) { lines.push_back(line); });
  EXPECT_EQ(end.exit_code, 5);
  EXPECT_THAT(lines, ElementsAre("last"));
}

}  // namespace
}  // namespace tachless::process
