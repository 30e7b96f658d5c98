// The driver of Universal Robots' arms by the maker's library, against a controller on 127.0.0.1.
// Only where the library is found (bench/ur.sh).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "plant/drivers/ur/emulated_controller.h"
#include "plant/drivers/ur/ur_driver.h"
#include "tests/plant/failure_of.h"

namespace tachless::ur {
namespace {

using base::ExitCode;
using base::Failure;
using plant::testing::failure_of;
using testing::AllOf;
using testing::Each;
using testing::HasSubstr;
using testing::SizeIs;

scenario::Scenario arm() {
  const char* script = std::getenv("TACHLESS_UR_SCRIPT");
  return scenario::load_scenario(
      TACHLESS_SOURCE_DIR "/examples/ur/arm.yaml",
      {"plant.driver.address=127.0.0.1", "plant.driver.command_timeout_s=0.2",
       std::string("plant.driver.script=") + (script == nullptr ? "" : script)});
}

class UrNetwork : public testing::Test {
 protected:
  /// Holds the arm by zero torques for `ticks`, stops it, and returns the failure.
  std::optional<Failure> hold(Trouble trouble, int ticks) {
    controller_.emplace(arm(), trouble);
    const std::jthread serving([&](const std::stop_token& ends) { controller_->serve(ends); });
    UrDriver driver(arm());
    driver.start();
    const auto failure = failure_of([&] {
      const plant::ArmState first = driver.read();
      for (int k = 0; k < ticks; ++k) driver.hold(Vector::Zero(6), 0);
      const plant::ArmState last = driver.read();
      EXPECT_GT(last.time_s, first.time_s + 1e-3 * ticks) << "the arm is the clock";
      EXPECT_LT((last.q - first.q).norm(), 1e-9) << "the arm adds gravity";
    });
    if (const auto stop = failure_of([&] { driver.stop(); })) stop_ = stop->what();
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the stop travels
    return failure;
  }

  std::optional<EmulatedController> controller_;
  std::string stop_;
};

TEST_F(UrNetwork, HoldsByTorquesWithoutTheArmsOwnFriction) {
  const auto failure = hold({}, 500);
  EXPECT_FALSE(failure) << failure->what();
  EXPECT_EQ(stop_, "");
  EXPECT_GT(controller_->torques, 400) << "a busy machine loses some ticks";
  EXPECT_THAT(controller_->scales, AllOf(SizeIs(12), Each(0)));
  EXPECT_FALSE(controller_->program_runs) << "the arm brakes";
}

/// The doctor, a ramp and a run are three clients of `tachless-ur emulate`.
TEST_F(UrNetwork, HasAControllerThatServesOneClientAfterTheOther) {
  controller_.emplace(arm());
  const std::jthread serving([&](const std::stop_token& ends) { controller_->serve(ends); });
  for (int client = 0; client < 3; ++client) {
    UrDriver driver(arm());
    driver.start();
    for (int k = 0; k < 50; ++k) driver.hold(Vector::Zero(6), 0);
    driver.stop();
    EXPECT_EQ(driver.figures()[0].value, 50);
  }
}

TEST_F(UrNetwork, NamesTheSafetyStop) {
  const auto failure = hold({.protective_stop_at = 50}, 500);
  ASSERT_TRUE(failure);
  EXPECT_EQ(failure->code(), ExitCode::protective_stop);
  EXPECT_THAT(failure->what(), HasSubstr("a protective stop: see the pendant"));
}

TEST_F(UrNetwork, NamesTheEndOfTheArmsProgram) {
  const auto failure = hold({.program_ends_at = 50}, 500);
  ASSERT_TRUE(failure);
  EXPECT_THAT(failure->what(), HasSubstr("the arm's program has ended"));
}

TEST_F(UrNetwork, SaysThatASilentArmStopsByItself) {
  const auto failure = hold({.silent_from = 50}, 500);
  ASSERT_TRUE(failure);
  EXPECT_THAT(failure->what(), HasSubstr("sent no state for 100 ms"));
  EXPECT_THAT(stop_, HasSubstr("the arm's program brakes it"));
}

}  // namespace
}  // namespace tachless::ur
