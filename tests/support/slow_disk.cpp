// Preloaded into a program whose disk is to take four seconds to have what was written; later calls
// find nothing new.
#include <sys/syscall.h>
#include <unistd.h>

extern "C" int fsync(int file) {
  static unsigned seconds = 4;
  sleep(seconds);
  seconds = 0;
  return static_cast<int>(syscall(SYS_fsync, file));
}
