#include "base/this_process.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>

namespace tachless::base {
namespace {

/// How a copy of this process ends that does `act`: its exit code, or minus the signal.
int end_of(bool (*act)()) {
  const pid_t pid = fork();
  if (pid == 0) _exit(act() ? 0 : 1);
  int status = 0;
  waitpid(pid, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

/// Raises the signal in a copy of this process. @return as `end_of`
int end_of_raised(int signal) {
  static int raised = 0;
  raised = signal;
  return end_of([] {
    const std::atomic<bool>& interrupted = catch_interruptions();
    if (interrupted) return false;
    raise(raised);
    return interrupted.load();
  });
}

TEST(Interruptions, AreEverySignalThatWouldEndTheProcess) {
  for (int signal = 1; signal <= SIGRTMAX; ++signal) {
    if (signal > SIGSYS && signal < SIGRTMIN) continue;  // glibc's own
    switch (signal) {
      case SIGKILL:  // cannot be handled
      case SIGSTOP:
      case SIGSEGV:  // errors in the program
      case SIGBUS:
      case SIGFPE:
      case SIGILL:
      case SIGABRT:
      case SIGTRAP:
      case SIGSYS:
      case SIGXFSZ:  // survive_file_size_limit
      case SIGCHLD:  // do not end a process
      case SIGCONT:
      case SIGURG:
      case SIGWINCH:
      case SIGTSTP:
      case SIGTTIN:
      case SIGTTOU:
        continue;
      default:
        EXPECT_EQ(end_of_raised(signal), 0) << signal;
    }
  }
}

TEST(Interruptions, IncludeAReaderOfTheOutputThatHasExited) {
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
}  // namespace tachless::base
