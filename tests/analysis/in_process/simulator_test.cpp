// A simulator in the place of the emulator's mechanics, in one process.

#include "plant/simulator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "in_process/in_process_loop.h"
#include "plant/plant_model.h"
#include "tests/analysis/in_process/short_run.h"
#include "tests/support/same_bits.h"

namespace tachless::in_process {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// The emulator's own arm behind the interface of a simulator.
class Arm final : public plant::Simulator {
 public:
  explicit Arm(const scenario::Scenario& scenario)
      : model_(plant::plant_model(scenario)),
        start_(plant::initial_state(scenario.plant, scenario.robot.flexible, model_)),
        make_([this, &scenario](const plant::ArmState& initial) {
          return std::unique_ptr<plant::Arm>(new plant::Arm(
              plant::make_arm(scenario.plant, scenario.robot.flexible, model_, initial)));
        }),
        arm_(make_(start_)) {}

  void reset(const plant::ArmState& initial) override {
    calls += 'r';
    arm_ = make_(initial);
  }
  plant::ArmState state() override { return wrong_state.value_or(arm_->state()); }
  void advance(const Vector& tau, double until_s) override {
    if (calls.size() == breaks_at) throw std::runtime_error("the world has run away");
    calls += 'a';
    arm_->advance(tau, until_s);
  }
  void brake(const Vector& damping) override {
    calls += 'b';
    arm_->brake(damping);
  }

  std::string calls;
  std::size_t breaks_at = 1'000'000;
  std::optional<plant::ArmState> wrong_state;

 private:
  robot::Model model_;
  plant::ArmState start_;
  std::function<std::unique_ptr<plant::Arm>(const plant::ArmState&)> make_;
  std::unique_ptr<plant::Arm> arm_;
};

std::string refusal(const scenario::Scenario& scenario, plant::Simulator& simulator) {
  try {
    records(scenario, &simulator);
  } catch (const base::Failure& failure) {
    return failure.what();
  }
  return "";
}

TEST(Simulator, HasTheEmulatorsEncodersDrivesAndDelaysAroundIt) {
  const scenario::Scenario scenario =
      practical({"plant.encoder.noise_std_rad=1e-5", "plant.encoder.latency_ticks=1",
                 "plant.drive.torque_limit_Nm=[60, 8]", "plant.on_limit=warn",
                 "plant.drive.command_age_jitter_ticks=1"});
  Arm arm(scenario);
  const auto own = records(scenario), simulated = records(scenario, &arm);
  ASSERT_EQ(own.size(), 200U);
  ASSERT_EQ(simulated.size(), 200U);
  for (std::size_t k = 0; k < own.size(); ++k) {
    EXPECT_TRUE(same_bits(own[k].truth.q, simulated[k].truth.q)) << k;
    EXPECT_TRUE(same_bits(own[k].applied.tau, simulated[k].applied.tau)) << k;
    EXPECT_TRUE(same_bits(own[k].command.tau, simulated[k].command.tau)) << k;
  }
  EXPECT_EQ(arm.calls, 'r' + std::string(200, 'a') + 'b') << "braked at the end";
}

TEST(Simulator, BeginsEachRunAnew) {
  const scenario::Scenario scenario = practical();
  Arm arm(scenario);
  const auto first = records(scenario, &arm), second = records(scenario, &arm);
  EXPECT_TRUE(same_bits(first.back().truth.q, second.back().truth.q));
}

TEST(Simulator, ThatThrowsEndsTheRunAtItsTick) {
  const scenario::Scenario scenario = practical();
  Arm arm(scenario);
  arm.breaks_at = 8;
  EXPECT_THAT(refusal(scenario, arm),
              AllOf(HasSubstr("at tick 7"), HasSubstr("the world has run away")));
}

TEST(Simulator, ThatGivesAnotherNumberOfJointsOrNoNumbersIsRefused) {
  const scenario::Scenario scenario = practical();
  Arm arm(scenario);
  arm.wrong_state = plant::ArmState{Vector::Zero(3), Vector::Zero(3), {}, {}};
  EXPECT_THAT(refusal(scenario, arm), HasSubstr("gave 3 positions and 3 velocities; the scenario "
                                                "has 2 joints"));
  const Vector nan = Vector::Constant(2, std::numeric_limits<double>::quiet_NaN());
  arm.wrong_state = plant::ArmState{nan, nan, {}, {}};
  EXPECT_THAT(refusal(scenario, arm), HasSubstr("not finite"));
}

TEST(Simulator, RefusesKeysOfMechanicsThatItHasItself) {
  for (const char* setting :
       {"plant.payload.mass_kg=1", "plant.drive.viscous_friction_Nms_per_rad=1",
        "plant.drive.coulomb_friction_Nm=1", "plant.drive.torque_scale=0.9",
        "plant.drive.current_loop_hz=500",
        "plant.disturbances=[{joint: elbow, torque_Nm: 1, start_s: 0.1}]"}) {
    const scenario::Scenario scenario = practical({setting});
    Arm arm(scenario);
    EXPECT_THAT(refusal(scenario, arm), HasSubstr("a simulator has its own mechanics")) << setting;
    EXPECT_EQ(arm.calls, "") << setting;
  }
}

}  // namespace
}  // namespace tachless::in_process
