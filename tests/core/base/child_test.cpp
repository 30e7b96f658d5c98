#include "base/child.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <string>
#include <thread>
#include <vector>

#include "base/failure.h"
#include "tests/support/temporary_directory.h"

namespace tachless::base {
namespace {

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

TEST(Child, EndsAreTakenThoughTheirSignalWasIgnored) {
  std::signal(SIGCHLD, SIG_IGN);
  EXPECT_EQ(run(shell("exit 3")).exit_code, 3);
  std::signal(SIGCHLD, SIG_IGN);
  EXPECT_TRUE(works_in_a_copy([] { return true; }));
  std::signal(SIGCHLD, SIG_DFL);
}

TEST(FindProgram, FindsNoFolder) {
  const TemporaryDirectory directory;
  std::filesystem::create_directory(directory.path() / "ls");
  const std::string path = std::getenv("PATH");
  setenv("PATH", (directory.path().string() + ":" + path).c_str(), 1);
  const auto found = find_program("ls");
  setenv("PATH", path.c_str(), 1);
  ASSERT_TRUE(found);
  EXPECT_NE(*found, directory.path() / "ls");
}

TEST(Child, ReadsNothingFromTheTerminal) {
  EXPECT_THAT(run(shell("read line; echo $?")).lines, ElementsAre("1"));
}

TEST(Child, ThatCannotBeStartedIsNamed) {
  try {
    run({"no-such-program"});
    FAIL();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("cannot start no-such-program: No such file"));
  }
  try {
    become({"/no/such/program"}, "build it");
  } catch (const base::Failure& failure) {
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

TEST(Child, OutlivesTheThreadThatStartedIt) {
  Child child;
  std::thread([&] { child = start(shell("sleep 1; echo alive")); }).join();
  std::vector<std::string> lines;
  const End end = end_within(child, seconds(60), [&](std::string line) { lines.push_back(line); });
  EXPECT_TRUE(end.well()) << text(end);
  EXPECT_THAT(lines, ElementsAre("alive"));
}

TEST(Child, NeverWaitsForItsReaderWhenItsOutputIsRelayed) {
  StartOptions relayed;
  relayed.relayed = true;
  Child child = start(shell("yes | head -c 4000000; echo last"), relayed);
  EXPECT_TRUE(take_end(child, true)->well()) << "nobody has read anything";
  std::vector<std::string> lines;
  read_rest(child, seconds(60), [&](std::string line) { lines.push_back(std::move(line)); });
  EXPECT_THAT(lines, ::testing::Contains(::testing::StartsWith(dropped_mark)));
  EXPECT_EQ(lines.back(), "last");
}

TEST(Child, ReportsNotices) {
  StartOptions noticed;
  noticed.gives_notices = true;
  Child child = start(shell("printf se >/proc/self/fd/$TACHLESS_NOTICE_FD"), noticed);
  EXPECT_TRUE(take_end(child, true)->well());
  EXPECT_THAT(take_notices(child), ElementsAre(Notice::robot_starts, Notice::robot_stopped));
}

}  // namespace
}  // namespace tachless::base
