#include "certify/feedforward_bound.h"

#include <gtest/gtest.h>

#include <numbers>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/core/robot/robots.h"

namespace tachless::certify {
namespace {

scenario::Scenario two_link(const std::vector<std::string>& overrides) {
  return linear::testing::shipped("practical_rigid", overrides);
}

/// Returns the largest |ID| at random postures and times.
Vector largest_found(const scenario::Scenario& scenario) {
  const robot::Model model = controller::rigid_model(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  robot::testing::Random random(1);
  Vector most = Vector::Zero(2);
  for (int k = 0; k < 200000; ++k) {
    const messages::ReferencePoint r = trajectory.at(random.uniform(0, scenario.loop.duration_s));
    const Vector q = random.vector(2, std::numbers::pi);
    most = most.cwiseMax(robot::inverse_dynamics(model, q, r.v_ref, r.a_ref).cwiseAbs());
  }
  return most;
}

class FeedforwardOf : public ::testing::TestWithParam<const char*> {};

/// The bound holds at every posture and time, and is no more than 1 % above what random ones show.
TEST_P(FeedforwardOf, TwoJointsIsBoundedClosely) {
  const scenario::Scenario scenario =
      two_link({std::string("reference=") + GetParam(), "loop.duration_s=3.2"});
  const FeedforwardBound bound = feedforward_bound(scenario);
  EXPECT_TRUE(bound.proved);
  const Vector found = largest_found(scenario);
  for (Eigen::Index i = 0; i < 2; ++i) {
    EXPECT_GE(bound.torque[i], found[i]);
    EXPECT_LE(bound.torque[i], 1.01 * found[i]);
  }
}
INSTANTIATE_TEST_SUITE_P(
    References, FeedforwardOf,
    ::testing::Values("{hold: {position_rad: [0.5, -0.4]}}",
                      "{sinusoid: {amplitude_rad: [0.5, 0.5], frequency_hz: [0.3183, 0.3183]}}",
                      "{point_to_point: {from_rad: [0, 0], to_rad: [1.5, 0.5], duration_s: 1.5}}",
                      "{sinusoid: {amplitude_rad: [1, 1], frequency_hz: [0.4775, 0.4775]}}"));

TEST(FeedforwardBound, ContainsTheFrictionThatIsFedForward) {
  const std::string motion = "reference={sinusoid: {amplitude_rad: 0.5, frequency_hz: 0.3183}}";
  const Vector without = feedforward_bound(two_link({motion})).torque;
  const Vector with =
      feedforward_bound(two_link({motion,
                                  "controller.friction={viscous: [8, 2], coulomb: [3, 1], "
                                  "smoothing: 0.1}"}))
          .torque;
  EXPECT_NEAR(with[0] - without[0], 8 + 3, 1e-3);  // |v_ref| is at most 1 rad/s
  EXPECT_NEAR(with[1] - without[1], 2 + 1, 1e-3);
}

/// The bound has gravity's largest torque and friction that falls with speed at its largest.
TEST(FeedforwardBound, ContainsFrictionThatRisesAndThatGrowsWithTheLoad) {
  const std::string motion = "reference={sinusoid: {amplitude_rad: 0.5, frequency_hz: 0.3183}}";
  const scenario::Scenario scenario = two_link({motion});
  const Vector without = feedforward_bound(scenario).torque;
  const Vector with =
      feedforward_bound(two_link({motion,
                                  "controller.friction={coulomb: [3, 1], rise: [2, -1], "
                                  "load: [0.1, 0]}"}))
          .torque;
  // Both links hang straight from the shoulder where gravity pulls most.
  const Vector most =
      robot::gravity_torque(controller::rigid_model(scenario), Vector{{0.5 * std::numbers::pi, 0}});
  EXPECT_GE(with[0] - without[0], 3 + 2 + 0.1 * std::abs(most[0]) - 1e-9);  // of rounding
  EXPECT_LE(with[0] - without[0], 3 + 2 + 0.11 * std::abs(most[0]));
  EXPECT_NEAR(with[1] - without[1], 1, 1e-12);
}

TEST(FeedforwardBound, OfManyJointsIsSampled) {
  EXPECT_FALSE(feedforward_bound(linear::testing::shipped("iiwa_point_to_point")).proved);
}

}  // namespace
}  // namespace tachless::certify
