// Preloaded into a program to make its disk take four seconds to store the written data. Later
// calls find no new data.
#include <sys/syscall.h>
#include <unistd.h>

extern "C" int fsync(int file) {
  static unsigned seconds = 4;
  sleep(seconds);
  seconds = 0;
  return static_cast<int>(syscall(SYS_fsync, file));
}
