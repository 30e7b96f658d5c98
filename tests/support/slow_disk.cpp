// Preloaded into a program whose disk is to take four seconds to have what was written.
#include <sys/syscall.h>
#include <unistd.h>

extern "C" int fsync(int file) {
  sleep(4);
  return static_cast<int>(syscall(SYS_fsync, file));
}
