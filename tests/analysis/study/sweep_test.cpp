#include "study/sweep.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <fstream>
#include <numbers>
#include <thread>

#include "base/failure.h"
#include "base/file_text.h"
#include "study/measures.h"
#include "tests/support/temporary_directory.h"

namespace tachless::study {
namespace {

using testing::HasSubstr;

const std::function<bool()> always = [] { return true; };
const Sweep::OnProgress unseen = [](std::int64_t /*done*/, std::int64_t /*all*/) {};

/// 12 short runs, some of which diverge.
SweepPlan small_plan() {
  const scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
                              {"plant.mechanics=native", "plant.integrator.accuracy=1e-5",
                               "loop.duration_s=0.1", "plant.initial.position_rad=[0.1, 0]"});
  SweepPlan plan;
  plan.name = scenario.name;
  plan.source = "practical_rigid.yaml";
  plan.text = scenario.text;
  plan.urdf = scenario.robot.urdf_text;
  plan.num_joints = scenario.num_joints;
  plan.laws = {{scenario.controller.law, {}}};
  plan.axes = {parse_axis("controller.gains.kp*=0.5:30:4:log", false),
               parse_axis("controller.gains.kd*=1,3,10", false)};
  return plan;
}

/// Returns the table that one undisturbed thread makes.
const std::string& expected_table() {
  static const std::string table = [] {
    const TemporaryDirectory directory;
    const Sweep sweep = Sweep::begin(directory.path(), small_plan());
    EXPECT_TRUE(sweep.run({}, 1, always, unseen));
    return sweep.table(sweep.rows());
  }();
  return table;
}

template <class F>
std::string problem_of(const F& action) {
  try {
    action();
  } catch (const base::Failure& failure) {
    return failure.what();
  }
  return "no failure";
}

class ASweep : public testing::Test {
 protected:
  TemporaryDirectory directory_;
  Sweep sweep_ = Sweep::begin(directory_.path(), small_plan());
};

TEST_F(ASweep, HasARowPerCaseAndDivergingIsOne) {
  EXPECT_TRUE(sweep_.run({}, 2, always, unseen));
  const std::vector<SweepRow> rows = sweep_.rows();
  ASSERT_EQ(rows.size(), 12U);
  int diverging = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].which.index, static_cast<std::int64_t>(i));
    diverging += rows[i].outcome == Outcome::diverging ? 1 : 0;
  }
  EXPECT_GT(diverging, 2);
  EXPECT_LT(diverging, 10);
  // The first is the scenario's run itself.
  const Measures alone = *measure(sweep_.plan().scenario(rows[0].which));
  EXPECT_EQ(rows[0].measures[0], alone.peak_error);
  EXPECT_GE(alone.peak_error, 0.1);  // it begins there
  EXPECT_EQ(rows[0].outcome, alone.verdict.outcome);
}

TEST_F(ASweep, TellsWhyARunStoppedInWordsAndNotAsAFieldOfATable) {
  EXPECT_TRUE(sweep_.run({}, 2, always, unseen));
  const auto file = directory_ / "rows-1-of-1.csv";
  const std::string text = base::file_text(file).value();
  const std::size_t reason = text.rfind(',') + 1;  // the last row's, which is empty
  std::ofstream(file) << text.substr(0, reason)
                      << "\"joint \"\"a\"\" is at 3, outside of its range\"\n";
  EXPECT_EQ(std::ranges::count(sweep_.rows(), "joint \"a\" is at 3, outside of its range",
                               &SweepRow::stopped),
            1);
}

TEST_F(ASweep, IsTheSameWhateverTheThreads) {
  EXPECT_TRUE(sweep_.run({}, 4, always, unseen));
  EXPECT_EQ(sweep_.table(sweep_.rows()), expected_table());
}

TEST_F(ASweep, InPartsIsTheSame) {
  for (int i = 1; i <= 3; ++i) EXPECT_TRUE(sweep_.run({i, 3}, 2, always, unseen));
  EXPECT_EQ(sweep_.counts().size(), 3U);
  EXPECT_EQ(sweep_.table(sweep_.rows()), expected_table());
}

TEST_F(ASweep, GoesOnWhereItWasBrokenOff) {
  std::atomic<int> questions = 0;
  std::int64_t finished = 0;
  int rounds = 0;
  while (finished < 12 && rounds < 50) {
    ++rounds;
    questions = 0;
    sweep_.run(
        {}, 2, [&] { return ++questions < 7; },
        [&](std::int64_t done, std::int64_t all) {
          EXPECT_EQ(all, 12);
          EXPECT_EQ(done, finished + 1);  // none is made twice
          finished = done;
        });
  }
  EXPECT_GT(rounds, 2);
  EXPECT_EQ(sweep_.table(sweep_.rows()), expected_table());
}

TEST_F(ASweep, MakesABrokenOffLineAgain) {
  EXPECT_TRUE(sweep_.run({}, 2, always, unseen));
  const auto file = directory_ / "rows-1-of-1.csv";
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 7);
  EXPECT_THAT(problem_of([&] { (void)sweep_.rows(); }), HasSubstr("1 of 12 runs are not finished"));
  std::int64_t made = 0;
  EXPECT_TRUE(sweep_.run({}, 2, always, [&](auto /*done*/, auto /*all*/) { ++made; }));
  EXPECT_EQ(made, 1);
  EXPECT_EQ(sweep_.table(sweep_.rows()), expected_table());
}

TEST_F(ASweep, NamesALineThatIsNotItsOwn) {
  std::ofstream(directory_ / "rows-1-of-2.csv") << "12,loria_ortega_rigid,1,1,converged\n";
  EXPECT_THAT(problem_of([&] { (void)sweep_.finished(); }),
              HasSubstr("rows-1-of-2.csv:1: no row of this sweep"));
}

TEST_F(ASweep, IsNotMixedWithAnother) {
  SweepPlan other = small_plan();
  other.axes.pop_back();
  EXPECT_THAT(problem_of([&] { Sweep::begin(directory_.path(), other); }),
              HasSubstr("another sweep is in this directory; name another one with --out"));
  EXPECT_EQ(Sweep::open(directory_.path()).plan().json(), small_plan().json());
  const TemporaryDirectory empty;
  EXPECT_THAT(problem_of([&] { Sweep::open(empty.path()); }), HasSubstr("there is no plan.json"));
}

TEST_F(ASweep, RunsAPartOnceAtATime) {
  std::string problem;
  EXPECT_TRUE(sweep_.run({}, 1, always, [&](std::int64_t done, std::int64_t /*all*/) {
    if (done != 1) return;
    problem = problem_of([&] { sweep_.run({}, 1, always, unseen); });
  }));
  EXPECT_THAT(problem, HasSubstr("another process runs this part of the sweep"));
}

TEST_F(ASweep, SaysWhichValuesTheScenarioDoesNotTake) {
  SweepPlan plan = small_plan();
  plan.axes = {parse_axis("plant.encoder.resolution_bits=20,20.5", false)};
  const TemporaryDirectory directory;
  const Sweep sweep = Sweep::begin(directory.path(), plan);
  EXPECT_THAT(problem_of([&] { sweep.run({}, 1, always, unseen); }),
              HasSubstr("--set plant.encoder.resolution_bits=20.5"));
}

// The torque's answer to a count: -(Kp + Kd beta) on its joint alone but for what the model's
// gravity and the feedback around it add. Kp + Kd beta with Tustin's beta = 2 b / (2 + a h) = 667
// 1/s is (707e3, 42.4e3); the filter's decay gives the answer back: over white errors the variance
// is (Kp + Kd beta)^2 + (Kd beta (1 - phi))^2 / (1 - phi^2), with phi = (2 - a h) / (2 + a h) =
// 1/3.
TEST(Sweep, ShardsThatBeginTogetherAllBegin) {
  const SweepPlan plan = small_plan();
  for (int round = 0; round < 50; ++round) {
    const TemporaryDirectory directory;
    std::atomic<int> waiting = 4;
    std::vector<std::string> problems(4);
    std::vector<std::thread> shards;
    for (std::string& problem : problems) {
      shards.emplace_back([&] {
        for (--waiting; waiting > 0;) {
        }
        problem = problem_of([&] { Sweep::begin(directory.path(), plan); });
      });
    }
    for (std::thread& shard : shards) shard.join();
    EXPECT_THAT(problems, testing::Each(problem_of([] {}))) << round;
    EXPECT_EQ(base::file_text(directory.path() / "plan.json"), plan.json());
  }
}

TEST(Measures, TorqueNoiseIsThatOfTheLawsGainOnCounts) {
  const auto scenario = [](std::vector<std::string> overrides) {
    overrides.insert(overrides.begin(), {"plant.mechanics=native", "loop.duration_s=0.5"});
    return scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
                                   overrides);
  };
  double sum = 0;
  for (const auto& [kp, kd] : {std::pair(40000.0, 1000.0), std::pair(2400.0, 60.0)}) {
    const double beta = 2 * 1000.0 / 3, phi = 1.0 / 3;
    const double at_once = kp + kd * beta, later = kd * beta * (1 - phi);
    sum += at_once * at_once + later * later / (1 - phi * phi);
  }
  // Quantisation of a motion is not quite white, and the loop answers: 10 %.
  const double rounding = 2 * std::numbers::pi / (1 << 20) / std::sqrt(12);
  EXPECT_NEAR(torque_noise(scenario({})) / (rounding * std::sqrt(sum / 2)), 1, 0.1);
  EXPECT_TRUE(std::isnan(torque_noise(scenario({"plant.encoder.resolution_bits=null"}))));
  // A run that diverges has no torque noise.
  EXPECT_TRUE(std::isnan(torque_noise(
      scenario({"controller.gains.kd=[20000, 1200]", "plant.integrator.accuracy=1e-5"}))));
}

/// `compare`: a row for each law, with the measures that a comparison adds.
TEST_F(ASweep, WithoutAxesComparesLaws) {
  SweepPlan plan = small_plan();
  plan.axes.clear();
  plan.laws.push_back({"computed_torque",
                       {"controller.law=computed_torque", "controller.gains={kp: 900, kd: 60}"}});
  const TemporaryDirectory directory;
  const Sweep sweep = Sweep::begin(directory.path(), plan);
  EXPECT_TRUE(sweep.run({}, 2, always, unseen, [](const auto& scenario, Measures& measures) {
    measures.largest_period_s = scenario.controller.law == "computed_torque" ? 2 : 1;
  }));
  const std::vector<SweepRow> rows = sweep.rows();
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[1].which.law, "computed_torque");
  EXPECT_EQ(measure_columns(true).back().name, "largest_period_s");
  EXPECT_EQ(rows[0].measures.back(), 1);
  EXPECT_EQ(rows[1].measures.back(), 2);
  EXPECT_THAT(sweep.table(rows), HasSubstr("case,law,outcome,peak_error,"));
  EXPECT_THAT(sweep.table(rows), HasSubstr(",torque_noise,largest_period_s,stopped\n"));
  EXPECT_EQ(measure_columns().back().name, "ticks");
}

}  // namespace
}  // namespace tachless::study
