#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

/// A thread that only sleeps, and how late it woke: what the machine, virtual perhaps, kept every
/// program from doing in time, the one under test included.
class Oversleep {
 public:
  using Clock = std::chrono::steady_clock;

  Oversleep()
      : thread_([this](const std::stop_token& stop) {
          while (!stop.stop_requested()) {
            const auto asleep = Clock::now();
            std::this_thread::sleep_for(nap);
            longest_ = std::max<Clock::rep>(longest_, (Clock::now() - asleep - nap).count());
          }
        }) {}

  [[nodiscard]] Clock::duration longest() const { return Clock::duration(longest_); }

 private:
  static constexpr std::chrono::milliseconds nap{2};

  std::atomic<Clock::rep> longest_ = 0;
  std::jthread thread_;
};
