#include "linear/missed_ticks.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cstdlib>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "controller/registry.h"
#include "linear/scenario_loop.h"
#include "numerics/decompositions.h"
#include "plant/guarded_robot.h"
#include "reference/make_trajectory.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::linear::missed_ticks_test {
namespace {

using namespace linear::testing;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Returns, for each tick, true if it is missed: rows of up to `most`, of random length or of the
/// longest, and between them few or many that are not.
std::vector<bool> pattern(std::mt19937_64& random, int most, int ticks) {
  std::vector<bool> missed;
  const bool longest = random() % 2 == 0;
  const int most_hits = random() % 2 == 0 ? 4 : 20;
  while (static_cast<int>(missed.size()) < ticks) {
    const auto row = longest ? most : 1 + static_cast<int>(random() % most);
    missed.insert(missed.end(), 1 + random() % most_hits, false);
    missed.insert(missed.end(), row, true);
  }
  missed.push_back(false);
  return missed;
}

/// The linearised loop in which a missed tick leaves the torque, and with `measurements` the law
/// too, which is given the straight line when the next one comes.
class LinearRun {
 public:
  LinearRun(const SampledLoop& loop, double h)
      : plant_(held(loop.plant, h)),
        law_(loop.law(h)),
        state_(VectorXd::Random(plant_.A.rows())),
        memory_(VectorXd::Zero(law_.A.rows())),
        queue_(static_cast<std::size_t>(loop.delay) + 1, VectorXd::Zero(plant_.B.cols())) {
    state_.tail(state_.size() - plant_.num_joints).setZero();
    last_ = measured();
  }

  void tick(bool missed, bool measurements) {
    if (missed && measurements) {
      ++gap_;
    } else {
      const VectorXd now = measured(), before = last_;
      VectorXd torque;
      for (int i = 1; i <= gap_ + 1; ++i) {
        const VectorXd y = before + (now - before) * i / (gap_ + 1);
        torque = law_.C * memory_ + law_.D * y;
        memory_ = law_.A * memory_ + law_.B * y;
      }
      if (!missed) queue_[0] = torque;
      last_ = now;
      gap_ = 0;
    }
    state_ = plant_.A * state_ + plant_.B * queue_.back();
    for (std::size_t i = queue_.size() - 1; i > 0; --i) queue_[i] = queue_[i - 1];
  }

  [[nodiscard]] double size() const { return state_.head(plant_.num_joints).norm(); }

 private:
  [[nodiscard]] VectorXd measured() const {
    const Index n = plant_.num_joints;
    VectorXd y(n * static_cast<Index>(law_.measured.size()));
    for (std::size_t i = 0; i < law_.measured.size(); ++i) {
      y.segment(static_cast<Index>(i) * n, n) =
          state_.segment(static_cast<Index>(law_.measured[i]) * n, n);
    }
    return y;
  }

  LinearPlant plant_;
  LinearLaw law_;
  VectorXd state_, memory_, last_;
  std::vector<VectorXd> queue_;  ///< [0]: of this tick
  int gap_ = 0;
};

TEST(GainsOfMissedTicks, AreTheNormsOfTheirOperators) {
  for (int m = 1; m <= 30; ++m) {
    MatrixXd sums = MatrixXd::Zero(m, m), laplacian = MatrixXd::Zero(m, m);
    for (int i = 0; i < m; ++i) {
      sums.row(i).head(i + 1).setOnes();
      laplacian(i, i) = 2;
      if (i > 0) laplacian(i, i - 1) = laplacian(i - 1, i) = -1;
    }
    EXPECT_NEAR(gain_of_missed_commands(m), numerics::spectral_norm(sums), 1e-12 * m);
    EXPECT_NEAR(gain_of_missed_measurements(m),
                numerics::spectral_norm(numerics::inverse(laplacian)), 1e-12 * m * m);
  }
  EXPECT_EQ(gain_of_missed_commands(0), 0);
  EXPECT_EQ(gain_of_missed_measurements(0), 0);
}

class MissedTicksOf : public ::testing::TestWithParam<const char*> {
 protected:
  const scenario::Scenario scenario = shipped(GetParam());
  const ScenarioLoop scenario_loop{scenario};
  const SampledLoop loop = scenario_loop.at(scenario_loop.rest_at(0));
  const double h = scenario.loop.period_s;

  MissedTicks found() const {
    MissedTicks result = missed_ticks(loop, h);
    find_unstable_pattern(loop, h, result);
    return result;
  }
  /// The largest error at the end of linear runs over its largest at the begin, over random
  /// patterns.
  double remaining(int most, bool measurements) const {
    std::mt19937_64 random(1);
    double worst = 0;
    const int ticks = static_cast<int>(4 * modes(loop, h).settling_s / h) + 20 * most;
    for (int k = 0; k < 200; ++k) {
      LinearRun run(loop, h);
      const double begin = run.size();
      for (const bool missed : pattern(random, most, ticks)) run.tick(missed, measurements);
      worst = std::max(worst, run.size() / begin);
    }
    return worst;
  }
};

TEST_P(MissedTicksOf, AreStableInEveryPatternTried) {
  const MissedTicks missed = found();
  ASSERT_GE(missed.commands, 1);
  EXPECT_LT(remaining(missed.commands, false), 1e-2);
  ASSERT_TRUE(missed.measurements.has_value());
  if (*missed.measurements > 0) {
    EXPECT_LT(remaining(*missed.measurements, true), 1e-2);
  }
}

TEST_P(MissedTicksOf, AreUnstableInThePatternThatIsNamed) {
  const MissedTicks missed = found();
  ASSERT_TRUE(missed.unstable.has_value());
  // A bound from the small-gain theorem; half of the truth is what it was seen to reach.
  EXPECT_LE(*missed.unstable, 2 * missed.commands + 2);
  // The other modes are gone after some hundred repetitions; then the largest of each hundred
  // grows.
  LinearRun run(loop, h);
  std::vector<double> largest(8, 0.0);
  for (std::size_t k = 0; k < 800; ++k) {
    for (int i = 0; i < *missed.unstable + missed.hits; ++i) run.tick(i < *missed.unstable, false);
    largest[k / 100] = std::max(largest[k / 100], run.size());
  }
  EXPECT_GT(largest[7], largest[3]);
}

/// The emulated robot itself, from where the scenario begins: [rad] at the end, of the worst joint.
double nonlinear_error_at_end(const scenario::Scenario& scenario, int most, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const std::vector<bool> missed = pattern(random, most, static_cast<int>(scenario.loop.num_ticks));
  const auto law = controller::scenario_law(scenario);
  plant::GuardedRobot robot(scenario);
  robot.feed(law->measurement());
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  robot.start();
  double error = 0;
  for (std::int64_t k = 0; k < scenario.loop.num_ticks; ++k) {
    const messages::ReferencePoint reference =
        trajectory.at(static_cast<double>(k) * scenario.loop.period_s);
    error = (robot.read(k).q - reference.q_ref).cwiseAbs().maxCoeff();
    const auto& command = law->step(k, robot.measure(k), reference).command;
    if (!missed[static_cast<std::size_t>(k)]) robot.accept(command);
    robot.advance(k);
    robot.end_tick();
  }
  return error;
}

// TACHLESS_PATTERNS=100000 for as many as one has time for.
TEST_P(MissedTicksOf, LeaveTheNonlinearLoopOnItsReference) {
  const char* const given = std::getenv("TACHLESS_PATTERNS");
  const int patterns = given == nullptr ? 12 : std::atoi(given);
  const int most = found().commands;
  // Errors settle within half a second each; native mechanics are Simbody's, ten times as fast.
  const scenario::Scenario scenario =
      shipped(GetParam(),
              {"plant.mechanics=native", "plant.integrator.accuracy=1e-6", "loop.duration_s=2"});
  const double begin = (VectorXd(scenario.plant.initial.position_rad) -
                        VectorXd(reference::make_trajectory(scenario).at(0).q_ref))
                           .cwiseAbs()
                           .maxCoeff();
  for (int seed = 0; seed < patterns; ++seed) {
    // The torque on the way is held too, up to `most` ticks: errors stay that are not there at 0.
    EXPECT_LT(nonlinear_error_at_end(scenario, most, static_cast<std::uint64_t>(seed)),
              0.2 * begin + 0.01)
        << "seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Shipped, MissedTicksOf,
                         ::testing::Values("practical_rigid", "ur5e", "iiwa_point_to_point"));

TEST(MissedTicks, OfALawThatMeasuresVelocityAreCommandsAlone) {
  const auto scenario = shipped(
      "practical_rigid",
      {"controller.law=computed_torque", "controller.gains={kp: [400, 400], kd: [40, 40]}"});
  const ScenarioLoop loop(scenario);
  const MissedTicks missed = missed_ticks(loop.at(loop.rest_at(0)), scenario.loop.period_s);
  EXPECT_GE(missed.commands, 1);
  EXPECT_FALSE(missed.measurements.has_value());
}

}  // namespace
}  // namespace tachless::linear::missed_ticks_test
