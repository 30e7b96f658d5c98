#include "process/process_tree.h"

#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

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
  EXPECT_THAT(threads_of(child), Contains(child));
  EXPECT_EQ(program_of(child), "test_process");
  ASSERT_TRUE(resident_kib(child).has_value());
  EXPECT_GT(*resident_kib(child), 100);
  kill(child, SIGKILL);
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  EXPECT_THAT(children_of(getpid()), Not(Contains(child)));
  EXPECT_THAT(children_of(child), IsEmpty());
  EXPECT_THAT(threads_of(child), IsEmpty());
  EXPECT_EQ(program_of(child), "");
  EXPECT_FALSE(resident_kib(child).has_value());
}

}  // namespace
}  // namespace tachless::process
