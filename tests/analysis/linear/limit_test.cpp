#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "certify/prediction.h"
#include "design/design.h"
#include "in_process/in_process_loop.h"
#include "linear/scenario_loop.h"
#include "scenario/scenario.h"
#include "study/measures.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/core/robot/robots.h"

namespace tachless::linear::limit_test {
namespace {

using namespace linear::testing;

/// Errors of a run without bounds on the torque, one column per tick; fewer ticks where it ended
/// for a torque that is not finite.
Eigen::MatrixXd errors(scenario::Scenario scenario, double period_s, Eigen::Index ticks,
                       double apart) {
  scenario.plant.mechanics = plant::Mechanics::native;
  scenario.plant.drive.torque_limit_Nm.reset();
  scenario.plant.encoder.resolution_bits.reset();
  scenario.loop.period_s = period_s;
  scenario.loop.num_ticks = ticks;
  scenario.loop.duration_s = period_s * static_cast<double>(ticks);
  Vector& start = scenario.plant.initial.position_rad;
  if (start.size() == 0) start = Vector::Zero(scenario.num_joints);
  if (const auto* hold = std::get_if<reference::trajectory::Hold>(&scenario.reference)) {
    start = hold->position_rad;
  }
  for (Eigen::Index i = 0; i < start.size(); ++i) start[i] += i % 2 == 0 ? apart : -apart / 2;
  Eigen::MatrixXd e(scenario.num_joints, ticks);
  Eigen::Index ran = 0;
  try {
    in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
      e.col(ran++) = record.truth.q - record.reference.q_ref;
      return true;
    });
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::protective_stop) << failure.what();
  }
  return e.leftCols(ran);
}

/// Largest over the last tenth: an oscillation passes zero.
double at_end(const Eigen::MatrixXd& e) {
  return e.rightCols(std::max<Eigen::Index>(1, e.cols() / 10)).cwiseAbs().maxCoeff();
}

/// Acceleration of the error at the end of a run [rad/s^2]: what grows beyond the limit is fast,
/// and ends, where it is not without bounds, in a limit cycle whose positions are small.
double restlessness(const Eigen::MatrixXd& e, double period_s) {
  if (!e.allFinite()) return std::numeric_limits<double>::infinity();
  const Eigen::Index n = e.cols() - 2;
  return at_end(e.leftCols(n) - 2 * e.middleCols(1, n) + e.rightCols(n)) / (period_s * period_s);
}

/// At 0.97 of the predicted limit what two runs begin apart dies away; at 1.05 the run does not
/// come to rest on its reference.
void expect_limit(const scenario::Scenario& scenario, const std::string& what) {
  SCOPED_TRACE(what);
  const ScenarioLoop loop(scenario);
  std::vector<SampledLoop> loops;
  for (const auto& rest : loop.rest_points(5)) loops.push_back(loop.at(rest));
  double limit = std::numeric_limits<double>::infinity();
  for (const SampledLoop& each : loops) {
    limit = std::min(limit, largest_stable_period(each).value());
  }
  const auto radius = [&](double period_s) {
    double result = 0;
    for (const SampledLoop& each : loops) result = std::max(result, radius_at(each, period_s));
    return result;
  };
  const double inside = radius(0.97 * limit), outside = radius(1.05 * limit);
  ASSERT_LT(inside, 1);
  ASSERT_GT(outside, 1);
  // Until the slowest mode is a twentieth of what it was, the fastest growing one ten million times
  // (of a difference in position a ten thousandth may be in it).
  const auto ticks = [](double factor, double per_tick) {
    return static_cast<Eigen::Index>(std::ceil(std::log(factor) / std::abs(std::log(per_tick))));
  };
  const Eigen::Index shrinks = ticks(20, inside), grows = ticks(1e7, outside);
  const Eigen::MatrixXd one = errors(scenario, 0.97 * limit, shrinks, 0);
  const Eigen::MatrixXd other = errors(scenario, 0.97 * limit, shrinks, 1e-6);
  ASSERT_EQ(std::min(one.cols(), other.cols()), shrinks);
  EXPECT_LT(at_end(one - other), 0.2 * 1e-6);
  const Eigen::MatrixXd beyond = errors(scenario, 1.05 * limit, grows, 1e-6);
  if (beyond.cols() < grows) return;  // it did not even run to its end
  EXPECT_GT(restlessness(beyond, 1.05 * limit), 100 * restlessness(other, 0.97 * limit));
}

/// Returns the outcome of a run at 1.2 times the limit, which `ticks` makes long enough for an
/// e-fold of growth.
study::Outcome outcome_beyond_limit(const std::string& name, std::vector<std::string> overrides,
                                    std::int64_t ticks) {
  scenario::Scenario scenario = shipped(name, overrides);
  const double period_s = 1.2 * certify::analyse(scenario, linear::Effort::quick).limit_s.value();
  overrides.push_back(fmt::format("loop.period_s={:.9g}", period_s));
  overrides.push_back(
      fmt::format("loop.duration_s={:.12g}", std::stod(fmt::format("{:.9g}", period_s)) * ticks));
  scenario = shipped(name, overrides);
  EXPECT_FALSE(certify::analyse(scenario, linear::Effort::quick).stable) << name;
  return study::measure(scenario).value().verdict.outcome;
}

/// In place of a motion from point to point, over which the limit differs.
void hold_at_the_end(scenario::Scenario& scenario) {
  const auto motion = std::get<reference::trajectory::PointToPoint>(scenario.reference);
  scenario.reference = reference::trajectory::Hold{motion.to_rad};
}

TEST(SampledLimit, IsWhereRunsOfThePapersScenariosStopConverging) {
  for (const char* name : {"paper_rigid", "paper_flexible"}) {
    for (const char* delay : {"loop.command_delay=0", "loop.command_delay=1"}) {
      expect_limit(shipped(name, {delay}), std::string(name) + ", " + delay);
    }
  }
}

TEST(SampledLimit, ARunBeyondItIsNoSuccess) {
  EXPECT_EQ(outcome_beyond_limit("paper_flexible",
                                 {"loop.command_delay=1", "plant.mechanics=native"}, 4000),
            study::Outcome::diverging);
  // `design` finds these gains for the arm without delay. The growth ends at the limits of its
  // torques, in a limit cycle. With `on_limit` other than `warn` the run would be stopped.
  const study::Outcome limited = outcome_beyond_limit(
      "xarm7",
      {"loop.command_delay=0", "plant.mechanics=native", "plant.on_limit=warn",
       "controller.gains.a=[61.7, 23.07, 1000, 1000, 208.3, 1000, 157]", "controller.gains.b=1000",
       "controller.gains.kd=[0.3186, 0.1855, 2.479, 4.568, 0.1085, 0.2311, 0.003942]",
       "controller.gains.kp=[12.97, 28.7, 58.3, 213.5, 1.821, 0.8497, 0.08286]"},
      1000);
  EXPECT_TRUE(study::bad(limited));
}

TEST(SampledLimit, IsThatOfRunsOfSevenJoints) {
  for (const char* delay : {"loop.command_delay=0", "loop.command_delay=1"}) {
    scenario::Scenario scenario = shipped("iiwa_point_to_point", {delay});
    hold_at_the_end(scenario);
    expect_limit(scenario, delay);
  }
}

TEST(SampledLimit, IsThatOfRunsOfSixJointsWithGainsOfDesign) {
  const std::string urdf = robot::testing::chain_urdf(6);
  scenario::Scenario scenario = scenario::parse_scenario(
      scenario::urdf_scenario(robot::model_from_urdf(urdf, "chain"), {"chain", "chain.urdf"}), urdf,
      "chain");
  // A short search keeps the margin, and the test asks for no optimum.
  scenario.controller.gains =
      design::design(scenario, {}, no_progress, {}, {.settling_s = 1e-3}).gains;
  hold_at_the_end(scenario);
  for (const int delay : {0, 1}) {
    scenario.loop.command_delay = delay;
    expect_limit(scenario, "delay " + std::to_string(delay));
  }
}

TEST(SampledLimit, IsThatOfRunsWithLongDelaysAndLateEncoders) {
  for (const auto& [delay, latency] : {std::pair{3, 0}, {16, 0}, {1, 4}, {0, 2}}) {
    scenario::Scenario scenario = shipped("practical_rigid");
    scenario.loop.command_delay = delay;
    scenario.plant.encoder.latency_ticks = latency;
    expect_limit(scenario, "delay " + std::to_string(delay) + ", " + std::to_string(latency));
  }
}

TEST(SampledLimit, IsThatOfRunsUnderEveryOtherLaw) {
  expect_limit(shipped("regulation"), "kelly_regulation");
  expect_limit(shipped("flexible_regulation"), "kelly_flexible");
  expect_limit(shipped("practical_rigid", {"controller.law=wen_bayard",
                                           "controller.gains={kp: [40000, 2400], kd: [1000, 60]}"}),
               "wen_bayard");
  expect_limit(shipped("practical_rigid", {"controller.law=slotine_li",
                                           "controller.gains={lambda: 20, ks: [500, 30]}"}),
               "slotine_li");
  expect_limit(shipped("practical_flexible",
                       {"controller.law=slotine_li_flexible",
                        "controller.gains={lambda: 20, ks1: [500, 30], ks2: [10, 10]}"}),
               "slotine_li_flexible");
}

}  // namespace
}  // namespace tachless::linear::limit_test
