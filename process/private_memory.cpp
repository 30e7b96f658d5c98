#include "process/private_memory.h"

#include <sys/prctl.h>

#include <cerrno>
#include <system_error>

namespace tachless::process {

void make_memory_private() {
  if (::prctl(PR_SET_DUMPABLE, 0UL) != 0) {
    throw std::system_error(errno, std::generic_category(), "prctl(PR_SET_DUMPABLE)");
  }
}

}  // namespace tachless::process
