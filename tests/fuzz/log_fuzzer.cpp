// Reads hostile files as logs: as events, and as a run, tick by tick.

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "base/failure.h"
#include "logger/log_file.h"
#include "logger/run_log.h"

using namespace tachless;

namespace {

/// Returns a named file in memory, which each input rewrites.
int file() {
  static const int fd = memfd_create("log", 0);
  if (fd < 0) std::abort();
  return fd;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (ftruncate(file(), 0) != 0 || pwrite(file(), data, size, 0) != static_cast<ssize_t>(size)) {
    std::abort();
  }
  const std::string path = "/proc/self/fd/" + std::to_string(file());
  std::size_t bytes = 0;
  logger::LogReader reader(path);
  while (const auto event = reader.next()) bytes += event->channel.size() + event->data.size();
  if (bytes > size) std::abort();
  try {
    logger::RunLog log = logger::RunLog::open(path);
    logger::TickRecord record;
    std::int64_t last = -1;
    while (log.next(record)) {
      if (record.tick <= last) std::abort();
      last = record.tick;
    }
  } catch (const base::Failure&) {
    // The file holds no run. The error is one line.
  }
  return 0;
}
