#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cstddef>

#include "logger/log_file.h"
#include "tests/support/counting_new.h"
#include "tests/support/damaged_log.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

TEST(LogFileAllocation, WritingAndReadingAnEventAllocatesNothing) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "log";
  LogWriter writer(path);
  std::array<std::byte, 100> data{};
  const std::size_t before = allocations;
  for (int i = 0; i < 30'000; ++i) {
    writer.append(i, "ARM_POSITION", data);
    writer.flush_if_due(std::chrono::steady_clock::now());
  }
  writer.close();
  EXPECT_EQ(allocations, before);
  LogReader reader(path);
  const std::size_t before_reading = allocations;
  int count = 0;
  while (reader.next()) ++count;
  EXPECT_EQ(allocations, before_reading);
  EXPECT_EQ(count, 30'000);
}

}  // namespace
}  // namespace tachless::logger
