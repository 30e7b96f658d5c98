#include "study/sweep_plan.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/failure.h"

namespace tachless::study {
namespace {

SweepPlan plan_of(const std::vector<std::string>& axes, std::int64_t drawn = 0) {
  const scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml");
  SweepPlan plan;
  plan.name = scenario.name;
  plan.source = "practical_rigid.yaml";
  plan.text = scenario.text;
  plan.urdf = scenario.robot.urdf_text;
  plan.num_joints = scenario.num_joints;
  plan.laws = {{scenario.controller.law, {}}};
  plan.drawn = drawn;
  for (const std::string& axis : axes) plan.add(parse_axis(axis, drawn > 0));
  return plan;
}

std::string problem_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const base::Failure& failure) {
    return failure.what();
  }
  return "no failure";
}

TEST(Axis, ReadsRangesAndLists) {
  EXPECT_EQ(parse_axis("loop.duration_s=1:3:5", false).values,
            (std::vector<double>{1, 1.5, 2, 2.5, 3}));
  const Axis logarithmic = parse_axis("controller.gains.kp*=0.01:100:5:log", false);
  ASSERT_EQ(logarithmic.values.size(), 5U);
  EXPECT_TRUE(logarithmic.factor);
  EXPECT_EQ(logarithmic.key, "controller.gains.kp");
  EXPECT_EQ(logarithmic.name(), "controller.gains.kp*");
  EXPECT_NEAR(logarithmic.values[1], 0.1, 1e-15);  // rounding of pow
  EXPECT_EQ(logarithmic.values.back(), 100);       // the ends are met exactly
  EXPECT_EQ(parse_axis("plant.encoder.resolution_bits=12,20", false).values,
            (std::vector<double>{12, 20}));
  EXPECT_EQ(parse_axis("plant.initial.position_rad[1]=-1:1:3", false).entry, 1);
}

TEST(Axis, SaysWhatIsWrongWithIt) {
  const auto problem = [](const std::string& text, bool drawn = false) {
    return problem_of([&] { parse_axis(text, drawn); });
  };
  EXPECT_EQ(problem("loop.period_s"), "--vary loop.period_s: no '='; write KEY=from:to:number");
  EXPECT_NE(problem("loop.period_s=1:2").find("KEY=from:to:number"), std::string::npos);
  EXPECT_NE(problem("loop.period_s=2:1:3").find("from 2 to 1; write 1:2"), std::string::npos);
  EXPECT_NE(problem("loop.period_s=1:2:2.5").find("2.5 values; allowed: a whole"),
            std::string::npos);
  EXPECT_NE(problem("loop.period_s=0:2:3:log").find("log from 0; allowed: above 0"),
            std::string::npos);
  EXPECT_NE(problem("loop.period_s=1,x").find("\"x\" is no number"), std::string::npos);
  EXPECT_NE(problem("plant.initial.position_rad[x]=0:1:2").find("whole number"), std::string::npos);
  EXPECT_NE(problem("5]=1:2:3").find("no '[' before ']'"), std::string::npos);
  EXPECT_NE(problem("loop.period_s=1:2:3", true).find("with --random"), std::string::npos);
  EXPECT_NE(problem("loop.period_s=1,2", true).find("cannot be drawn"), std::string::npos);
}

TEST(SweepPlan, RefusesAnAxisThatIsNoNumberOfAScenario) {
  for (const auto& [axis, answer] :
       {std::pair{"loop.period=1:2:3", "nearest known key is loop.period_s"},
        {"plant=1:2:3", "plant: 1; allowed: a map"}}) {
    const SweepPlan plan = plan_of({axis});
    EXPECT_NE(problem_of([&] { (void)plan.scenario(plan.at(0)); }).find(answer), std::string::npos);
  }
}

TEST(SweepPlan, NumbersTheCasesLawsOutermostLastAxisInnermost) {
  SweepPlan plan = plan_of({"loop.duration_s=1,2", "plant.payload.mass_kg=0:2:3"});
  plan.laws.push_back({"wen_bayard", {"controller.law=wen_bayard"}});
  ASSERT_EQ(plan.num_cases(), 12);
  EXPECT_EQ(plan.at(1).values, (std::vector<double>{1, 1}));
  EXPECT_EQ(plan.at(3).values, (std::vector<double>{2, 0}));
  EXPECT_EQ(plan.at(5).law, "loria_ortega_rigid");
  EXPECT_EQ(plan.at(6).law, "wen_bayard");
  EXPECT_EQ(plan.at(11).values, (std::vector<double>{2, 2}));
  EXPECT_EQ(plan.scenario(plan.at(11)).controller.law, "wen_bayard");
}

TEST(SweepPlan, SetsMultipliesAndChangesSingleJoints) {
  const SweepPlan plan =
      plan_of({"controller.gains.kp*=2,3", "plant.initial.position_rad[1]=0.25,1",
               "plant.payload.mass_kg=0.5,1"});
  const scenario::Scenario scenario = plan.scenario(plan.at(0));
  // The scenario has kp [40000, 2400] and position [0, 0].
  EXPECT_EQ(scenario.controller.gains.at("kp")[0], 80000);
  EXPECT_EQ(scenario.controller.gains.at("kp")[1], 4800);
  EXPECT_EQ(scenario.plant.initial.position_rad[0], 0);
  EXPECT_EQ(scenario.plant.initial.position_rad[1], 0.25);
  EXPECT_EQ(scenario.plant.payload.mass_kg, 0.5);
  // Given nowhere: zero for every joint that is not named.
  const SweepPlan velocity = plan_of({"plant.initial.velocity_rad_per_s[0]=0.5,1"});
  EXPECT_EQ(velocity.scenario(velocity.at(0)).plant.initial.velocity_rad_per_s[0], 0.5);
  const SweepPlan none = plan_of({"plant.payload.mass_kg*=1,2"});
  EXPECT_NE(problem_of([&] { (void)none.scenario(none.at(0)); }).find("gives no number"),
            std::string::npos);
  const SweepPlan third = plan_of({"plant.initial.position_rad[2]=0,1"});
  EXPECT_NE(problem_of([&] { (void)third.scenario(third.at(0)); }).find("allowed: 0 to 1"),
            std::string::npos);
}

TEST(SweepPlan, AVariedPeriodKeepsWholePeriodsInTheRun) {
  const SweepPlan plan = plan_of({"loop.period_s=7e-4,3e-3"});
  const scenario::LoopSpec loop = plan.scenario(plan.at(0)).loop;
  EXPECT_EQ(loop.num_ticks, 7143);  // 5 s / 0.7 ms = 7142.9
  EXPECT_NEAR(loop.duration_s, 5, 7e-4);
  // A factor multiplies the period of the scenario: 1 ms.
  const SweepPlan factor = plan_of({"loop.period_s*=0.7,3"});
  EXPECT_EQ(factor.scenario(factor.at(0)).loop.num_ticks, 7143);
}

TEST(SweepPlan, AVariedPeriodKeepsWholePeriodsInADurationThatIsVariedToo) {
  const SweepPlan plan = plan_of({"loop.period_s=1e-3,1.5e-3", "loop.duration_s=1,1.0005"});
  EXPECT_EQ(plan.scenario(plan.at(3)).loop.num_ticks, 667);
}

TEST(SweepPlan, RefusesTwoAxesOfOneNumber) {
  const auto problem = [](const std::string& first, const std::string& second) {
    return problem_of([&] { plan_of({first, second}); });
  };
  EXPECT_NE(problem("controller.gains.kp*=1,2", "controller.gains.kp*=1,3").find("same number"),
            std::string::npos);
  EXPECT_NE(problem("controller.gains.kp=1,2", "controller.gains.kp[0]=1,3").find("same number"),
            std::string::npos);
  EXPECT_EQ(problem("controller.gains.kp[0]=1,2", "controller.gains.kp[1]=1,3"), "no failure");
}

TEST(SweepPlan, RefusesAFileWithoutLaws) {
  const SweepPlan plan = plan_of({"loop.duration_s=1,2"});
  const std::string whole = plan.json();
  const std::string json = whole.substr(0, whole.find('[', whole.find("\"laws\""))) + "[]" +
                           whole.substr(whole.find(",\n \"vary\""));
  EXPECT_NE(problem_of([&] { SweepPlan::from_json(json, "plan.json"); }).find("no laws"),
            std::string::npos);
}

TEST(SweepPlan, VariesLargeWholeNumbers) {
  const SweepPlan plan = plan_of({"plant.encoder.seed=100000,2000000"});
  EXPECT_EQ(plan.scenario(plan.at(1)).plant.encoder.seed, 2000000);
}

TEST(SweepPlan, BoundsItsRunsAndCountsThoseOfAllLaws) {
  SweepPlan plan = plan_of({"plant.payload.mass_kg=0:2"}, 9'000'000'000'000'000'000);
  plan.laws.push_back({"wen_bayard", {}});
  EXPECT_EQ(problem_of([&] { (void)plan.num_cases(); }),
            "a sweep of 1.8e+19 runs; allowed: at most 1e+08");
}

TEST(SweepPlan, IsWrittenOfAFileWhoseNameIsNoUtf8) {
  SweepPlan plan = plan_of({"plant.payload.mass_kg=0,1"});
  plan.source = "caf\xe9.yaml";
  EXPECT_EQ(SweepPlan::from_json(plan.json(), "plan.json").source, "caf\uFFFD.yaml");
}

TEST(SweepPlan, DrawsDependOnSeedCaseAndAxisAlone) {
  const std::vector<std::string> axes = {"plant.payload.mass_kg=0:2",
                                         "controller.gains.kp*=0.01:1:log"};
  SweepPlan plan = plan_of(axes, 400);
  SweepPlan again = plan_of(axes, 1000);
  double sum = 0, log_sum = 0;
  for (int i = 0; i < 400; ++i) {
    const SweepCase which = plan.at(i);
    EXPECT_EQ(which.values, again.at(i).values);
    EXPECT_GE(which.values[0], 0);
    EXPECT_LE(which.values[0], 2);
    sum += which.values[0] / 400;
    log_sum += std::log10(which.values[1]) / 400;
  }
  // Means of 400 even draws: 4 standard deviations are 4 * width / sqrt(12 * 400).
  EXPECT_NEAR(sum, 1, 0.116);
  EXPECT_NEAR(log_sum, -1, 0.116);
  again.seed = 2;
  EXPECT_NE(plan.at(0).values, again.at(0).values);
  // Laws are compared at the same draws.
  plan.laws.push_back({"wen_bayard", {}});
  EXPECT_EQ(plan.at(3).values, plan.at(403).values);
}

TEST(SweepPlan, IsWholeAgainFromItsText) {
  SweepPlan plan = plan_of({"controller.gains.kp*=1:2:3:log"});
  plan.laws.push_back({"wen_bayard", {"controller.law=wen_bayard"}});
  const SweepPlan read = SweepPlan::from_json(plan.json(), "plan.json");
  EXPECT_EQ(read.json(), plan.json());
  EXPECT_EQ(read.num_cases(), 6);
  EXPECT_NE(problem_of([] {
              SweepPlan::from_json("{}", "plan.json");
            }).find("plan.json: not a sweep's plan"),
            std::string::npos);
  EXPECT_NE(problem_of([] {
              SweepPlan::from_json(R"({"version": 99})", "plan.json");
            }).find("version 99"),
            std::string::npos);
}

}  // namespace
}  // namespace tachless::study
