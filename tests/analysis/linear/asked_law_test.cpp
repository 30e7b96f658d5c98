// The sampled loop of a law from its answers, against that of its equations, for the shipped arms.

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "certify/prediction.h"
#include "controller/registry.h"
#include "scenario/scenario.h"
#include "tests/analysis/linear/answers.h"

namespace tachless::linear::asked_law_test {
namespace {

class AskedLaw : public ::testing::TestWithParam<std::string> {};

TEST_P(AskedLaw, HasTheLoopOfItsEquations) {
  scenario::Scenario scenario =
      scenario::load_scenario(std::string(TACHLESS_SOURCE_DIR "/") + GetParam(), {});
  const certify::Prediction inside = certify::analyse(scenario, linear::Effort::margins);
  const LawAnswers answers = answers_of(scenario);
  scenario.controller.measurement = controller::law_facts(scenario.controller.law).measurement;
  const certify::Prediction asked =
      certify::analyse(scenario, linear::Effort::margins, no_progress, answers);
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

INSTANTIATE_TEST_SUITE_P(Shipped, AskedLaw,
                         ::testing::Values("scenarios/paper_rigid.yaml",
                                           "scenarios/practical_rigid.yaml",
                                           "scenarios/practical_flexible.yaml",
                                           "scenarios/ur5e.yaml", "scenarios/panda.yaml",
                                           "examples/iiwa/iiwa.yaml"));

}  // namespace
}  // namespace tachless::linear::asked_law_test
