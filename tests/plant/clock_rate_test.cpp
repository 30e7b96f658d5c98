#include "plant/clock_rate.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>

namespace tachless::plant {
namespace {

using namespace std::chrono_literals;
using Time = ClockRate::Time;

constexpr double period_s = 1e-3;
constexpr double longest_stall_s = 0.4;

/// A driver whose time runs at `rate`, read once per millisecond of a clock that a test moves on.
class Driver {
 public:
  explicit Driver(double epoch_s = 0) : own_s_(epoch_s) {}

  /// @return the number of windows that are not sound in so many readings
  int read(int readings, double rate = 1) {
    int wrong = 0;
    for (int i = 0; i < readings; ++i) {
      now_ += 1ms;
      own_s_ += rate * 1e-3;
      wrong += is_wrong(own_s_) ? 1 : 0;
    }
    return wrong;
  }
  /// This process stands still. A driver that keeps its readings then hands them over one by one.
  int stall(int milliseconds, bool keeps_readings) {
    now_ += milliseconds * 1ms;
    int wrong = 0;
    for (int i = 0; keeps_readings && i < milliseconds; ++i) {
      own_s_ += 1e-3;
      now_ += 50us;
      wrong += is_wrong(own_s_) ? 1 : 0;
    }
    if (!keeps_readings) own_s_ += 1e-3 * milliseconds;
    return wrong;
  }
  bool is_wrong(double own_s) {
    const auto window = rate_.add(own_s, now_, now_ + 20us);
    if (window) last_ = *window;
    return window && !window->sound;
  }
  [[nodiscard]] double rate() const { return last_.rate; }

 private:
  ClockRate rate_{period_s, longest_stall_s};
  Time now_ = Time() + 1h;
  double own_s_;
  ClockRate::Window last_;
};

TEST(ClockRate, AcceptsADriversTimeFromAnyEpoch) {
  for (const double epoch_s : {0.0, -3.0, 1.8e9}) {
    Driver driver(epoch_s);
    EXPECT_EQ(driver.read(5000), 0) << epoch_s;
    EXPECT_NEAR(driver.rate(), 1, 0.01);
  }
}

TEST(ClockRate, NamesAnotherUnit) {
  for (const double unit : {1e3, 1e6, 1e9, 1e-3, 1e-9, 0.0, 3.0, 0.3}) {
    Driver driver;
    EXPECT_GE(driver.read(105, unit), 4) << unit;
    EXPECT_NEAR(driver.rate(), unit, 0.01 * unit);
  }
}

TEST(ClockRate, NoticesWithinTwoWindowsThatTheRateChanges) {
  for (const double unit : {1e3, 1e-3, 0.0, 3.0, 0.3}) {
    Driver driver;
    ASSERT_EQ(driver.read(10'000), 0);
    EXPECT_GE(driver.read(45, unit), 1) << unit;
  }
}

TEST(ClockRate, AcceptsAStallOfThisProcess) {
  for (const bool keeps_readings : {false, true}) {
    for (const int stall : {3, 15, 60, 390}) {
      Driver driver;
      ASSERT_EQ(driver.read(1000), 0);
      EXPECT_EQ(driver.stall(stall, keeps_readings), 0) << stall;
      EXPECT_EQ(driver.read(1000), 0) << stall;
    }
  }
}

TEST(ClockRate, JudgesNothingWithoutATime) {
  Driver driver;
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(driver.is_wrong(std::numeric_limits<double>::quiet_NaN()));
  }
}

}  // namespace
}  // namespace tachless::plant
