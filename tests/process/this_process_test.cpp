#include "process/this_process.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>

namespace tachless::process {
namespace {

/// How a copy of this process ends that does `act`: its exit code, or minus the signal.
int end_of(bool (*act)()) {
  const pid_t pid = fork();
  if (pid == 0) _exit(act() ? 0 : 1);
  int status = 0;
  waitpid(pid, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

TEST(Interruptions, AreNotedAndEndNobodyAtOnce) {
  EXPECT_EQ(end_of([] {
              for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE}) {
                const std::atomic<bool>& interrupted = catch_interruptions();
                if (interrupted && signal == SIGINT) return false;
                raise(signal);
                if (!interrupted) return false;
              }
              return true;
            }),
            0);
}

TEST(Interruptions, OfWhoeverReadsTheOutputAreNotedToo) {
  EXPECT_EQ(end_of([] {
              std::array<int, 2> ends{};
              if (pipe(ends.data()) != 0) return false;
              close(ends[0]);
              const std::atomic<bool>& interrupted = catch_interruptions();
              return write(ends[1], "x", 1) < 0 && interrupted;
            }),
            0);
}

}  // namespace
}  // namespace tachless::process
