#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <new>

#include "logger/log_file.h"
#include "tests/logger/damaged_log.h"

namespace {
std::atomic<long> allocations = 0;
}

void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace logger {
namespace {

TEST(LogFileAllocation, WritingAndReadingAnEventAllocatesNothing) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "log";
  LogWriter writer(path);
  std::array<std::byte, 100> data{};
  const long before = allocations;
  for (int i = 0; i < 30'000; ++i) {
    writer.append(i, "ARM_POSITION", data);
    writer.flush_if_due(std::chrono::steady_clock::now());
  }
  writer.close();
  EXPECT_EQ(allocations, before);
  LogReader reader(path);
  const long before_reading = allocations;
  int count = 0;
  while (reader.next()) ++count;
  EXPECT_EQ(allocations, before_reading);
  EXPECT_EQ(count, 30'000);
}

}  // namespace
}  // namespace logger
