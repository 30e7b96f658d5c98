#include "base/parallel.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <thread>
#include <vector>

namespace tachless::base {
namespace {

TEST(ParallelFor, CallsForEachIndexOnce) {
  for (const std::size_t count : {0u, 1u, 2u, 1000u}) {
    std::vector<int> calls(count, 0), each(count, 1);
    parallel_for(count, [&](std::size_t i) { ++calls[i]; });
    EXPECT_EQ(calls, each) << count;
  }
}

TEST(ParallelFor, ThrowsWhatWasThrownAndCallsNoFurther) {
  std::vector<int> calls(100'000, 0);
  EXPECT_THAT(
      [&] {
        parallel_for(calls.size(), [&](std::size_t i) {
          ++calls[i];
          if (i == 10) throw std::runtime_error("the tenth");
          // All the others would take 100 s: longer than the thread that throws can be held up.
          if (i > 10) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        });
      },
      testing::ThrowsMessage<std::runtime_error>("the tenth"));
  EXPECT_EQ(calls[10], 1);
  EXPECT_EQ(calls.back(), 0);
}

}  // namespace
}  // namespace tachless::base
