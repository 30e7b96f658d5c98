// An arm that is the clock moves, and states of some of its ticks never arrive.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>

#include "controller/registry.h"
#include "plant/guarded_robot.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"

namespace tachless::plant {
namespace {

/// Arm with seven joints whose controller is the clock. After tick `at` it goes on for `lost` ticks
/// with the last torque before it tells its state.
class ArmThatLosesStates final : public ClockDriver {
 public:
  ArmThatLosesStates(const scenario::Scenario& s, std::int64_t at, std::int64_t lost, bool tells)
      : model_(plant_model(s)),
        robot_(s.plant, s.robot.flexible, s.loop.period_s, model_),
        period_s_(s.loop.period_s),
        at_(at),
        lost_(lost),
        tells_(tells) {}
  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override { robot_.start(); }
  void stop() override { robot_.stop(); }

 private:
  ArmState exchange(const Vector& tau) override {
    ++tick_;  // before the start the arm stands on its brakes
    if (tau.size() > 0) {
      move(tau);
      if (moved_++ == at_) {
        for (std::int64_t i = 0; i < lost_; ++i, ++tick_) move(tau);
      }
    }
    ArmState state = robot_.read();
    state.time_s = static_cast<double>(tells_ ? tick_ : ++answers_) * period_s_;
    return state;
  }
  void move(const Vector& tau) { robot_.hold(tau, static_cast<double>(++held_) * period_s_); }

  robot::Model model_;
  EmulatedRobot robot_;
  double period_s_;
  std::int64_t at_, lost_, tick_ = 0, answers_ = 0, moved_ = 0, held_ = 0;
  bool tells_;  ///< its time goes on over lost states
};

using Torques = std::map<std::int64_t, Vector>;

/// Returns the law's torques by the arm's ticks.
Torques torques_of_run(std::int64_t lost, bool tells) {
  const scenario::Scenario s = scenario::load_scenario(
      TACHLESS_SOURCE_DIR "/scenarios/iiwa_point_to_point.yaml",
      {"loop.mode=realtime", "loop.duration_s=1.5", "plant.mechanics=native",
       "plant.encoder.resolution_bits=null", "plant.initial.torque=hold"});
  ArmThatLosesStates arm(s, 1000, lost, tells);
  const controller::ScenarioLaw law = controller::scenario_law(s);
  const reference::Trajectory trajectory = reference::make_trajectory(s);
  GuardedRobot robot(s, &arm);
  robot.feed(law->measurement());
  robot.start();
  Torques torques;
  for (std::int64_t k = 0; k < s.loop.num_ticks; ++k) {
    robot.read(k);
    robot.skip(robot.tick() - k);
    k = robot.tick();
    const auto outcome =
        law->step(k, robot.measure(k), trajectory.at(static_cast<double>(k) * s.loop.period_s));
    torques[k] = outcome.command.tau;
    robot.accept(outcome.command);
    robot.advance(k);
    robot.end_tick();
  }
  return torques;
}

double largest_difference(const Torques& torques, const Torques& others) {
  double largest = 0;
  for (const auto& [tick, tau] : torques) {
    const auto other = others.find(tick);
    if (other == others.end()) continue;
    largest = std::max(largest, (tau - other->second).cwiseAbs().maxCoeff());
  }
  return largest;
}

TEST(LostStates, OfAnArmInMotionAreNoTorqueStepWhereItTellsItsTime) {
  const Torques undisturbed = torques_of_run(0, true);
  ASSERT_EQ(undisturbed.size(), 1500U);
  const Torques lost = torques_of_run(15, true);
  EXPECT_EQ(lost.size(), 1485U);
  EXPECT_EQ(lost.count(1000), 1U);
  EXPECT_EQ(lost.count(1001), 0U);
  EXPECT_EQ(lost.count(1015), 0U);
  EXPECT_EQ(lost.count(1016), 1U);
  EXPECT_LT(largest_difference(lost, undisturbed), 0.5);
  // Without these ticks in its time the arm moves 16 ticks' way in one, for all the law knows.
  EXPECT_GT(largest_difference(torques_of_run(15, false), undisturbed), 2);
}

}  // namespace
}  // namespace tachless::plant
