// The sampled loop of a law from its answers, against that of its equations, for the shipped arms.

#include <gtest/gtest.h>

#include <cmath>
#include <iterator>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "certificate/prediction.h"
#include "controller/registry.h"
#include "experiment/scenario.h"

namespace tachless::certificate {
namespace {

/// The scenario's own law, asked as a program is.
LawAnswers answers_of(const experiment::Scenario& scenario) {
  robot::Model model = *scenario.model;
  model.gravity.setZero();
  experiment::Scenario without_gravity = scenario;
  without_gravity.model = std::make_shared<const robot::Model>(model);
  return [=](double period_s, bool weightless, std::span<const loop::AnyMeasurement> measurements,
             const loop::ReferencePoint& reference) {
    experiment::Scenario at = weightless ? without_gravity : scenario;
    at.loop.period_s = period_s;
    const controller::ScenarioLaw law = controller::scenario_law(at);
    std::vector<robot::Vector> torques;
    for (const loop::AnyMeasurement& each : measurements) {
      torques.push_back(law->step(std::ssize(torques), each, reference).command.tau);
    }
    return torques;
  };
}

class AskedLaw : public ::testing::TestWithParam<std::string> {};

TEST_P(AskedLaw, HasTheLoopOfItsEquations) {
  experiment::Scenario scenario =
      experiment::load_scenario(std::string(TACHLESS_SOURCE_DIR "/") + GetParam(), {});
  const Prediction inside = analyse(scenario, Effort::margins);
  const LawAnswers answers = answers_of(scenario);
  scenario.controller.measurement = controller::law_facts(scenario.controller.law).measurement;
  const Prediction asked = analyse(scenario, Effort::margins, no_progress, answers);
  ASSERT_EQ(asked.unknown, "");
  EXPECT_EQ(asked.stable, inside.stable);
  // A deviation of 1e-6 rad beside an angle of 1 rad is rounded by 1e-10 of it, each torque by as
  // much of its largest term; gains a thousandth of others' lose three digits of that.
  const auto expect_near = [](const char* what, double is, double expected) {
    EXPECT_NEAR(is, expected, 1e-5 * std::abs(expected)) << what;
  };
  expect_near("limit", *asked.limit_s, *inside.limit_s);
  expect_near("decay", asked.modes.decay_per_s, inside.modes.decay_per_s);
  expect_near("settling", asked.modes.settling_s, inside.modes.settling_s);
  expect_near("stiffness", (asked.stiffness - inside.stiffness).norm() + inside.stiffness.norm(),
              inside.stiffness.norm());
  ASSERT_TRUE(asked.margins && inside.margins);
  for (const auto each : {&Margins::modulus, &Margins::modulus_independent, &Margins::gain,
                          &Margins::phase_deg, &Margins::delay_s}) {
    expect_near("margin", (*asked.margins).*each, (*inside.margins).*each);
  }
}

TEST(AnAskedLaw, OnFlexibleJointsIsNotAnalysed) {
  experiment::Scenario scenario =
      experiment::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_flexible.yaml", {});
  const LawAnswers answers = answers_of(scenario);
  scenario.controller.measurement = controller::law_facts(scenario.controller.law).measurement;
  const Prediction asked = analyse(scenario, Effort::quick, no_progress, answers);
  EXPECT_EQ(asked.unknown, "on flexible joints no model is made of a law's answers");
}

INSTANTIATE_TEST_SUITE_P(Shipped, AskedLaw,
                         ::testing::Values("scenarios/paper_rigid.yaml",
                                           "scenarios/practical_rigid.yaml", "scenarios/ur5e.yaml",
                                           "scenarios/panda.yaml", "examples/iiwa/iiwa.yaml"));

}  // namespace
}  // namespace tachless::certificate
