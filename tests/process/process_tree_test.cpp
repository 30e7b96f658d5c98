#include "process/process_tree.h"

#include <gmock/gmock.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "tests/support/process_facts.h"

namespace tachless::process {
namespace {

using ::testing::Contains;
using ::testing::IsEmpty;
using ::testing::Not;

TEST(ProcessTree, KnowsAChildAndWhatItRunsUntilItIsGone) {
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    pause();
    _exit(0);
  }
  EXPECT_THAT(children_of(getpid()), Contains(child));
  EXPECT_FALSE(has_socket(child));
  set_idle_priority(child);
  EXPECT_EQ(sched_getscheduler(child), SCHED_IDLE);
  EXPECT_EQ(support::program_of(child), "test_process");
  ASSERT_TRUE(support::resident_kib(child).has_value());
  EXPECT_GT(*support::resident_kib(child), 100);
  kill(child, SIGKILL);
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  EXPECT_THAT(children_of(getpid()), Not(Contains(child)));
  EXPECT_THAT(children_of(child), IsEmpty());
  EXPECT_FALSE(has_socket(child));
  set_idle_priority(child);
  EXPECT_EQ(support::program_of(child), "");
  EXPECT_FALSE(support::resident_kib(child).has_value());
}

}  // namespace
}  // namespace tachless::process
