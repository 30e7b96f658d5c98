#include "process/child.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <string>
#include <vector>

#include "diagnostics/failure.h"

namespace tachless::process {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

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

}  // namespace
}  // namespace tachless::process
