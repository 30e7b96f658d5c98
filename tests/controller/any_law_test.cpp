#include "controller/any_law.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "controller/law/loria_ortega_rigid.h"
#include "controller/registry.h"
#include "robot/dynamics.h"

namespace tachless::controller {
namespace {

using law::LoriaOrtegaRigid;

scenario::Scenario scenario(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(), "loop.mode=realtime");
  return scenario::load_scenario(
      std::string(TACHLESS_SOURCE_DIR) + "/scenarios/practical_rigid.yaml", overrides);
}

messages::ReferencePoint at_zero() {
  const Vector zero = Vector::Zero(2);
  return {zero, zero, zero, zero, zero};
}

/// Returns a measurement whose error is linear in time, as a first-order hold assumes.
messages::PositionMeasurement ramp(std::int64_t tick) {
  messages::PositionMeasurement measurement;
  measurement.q.resize(2);
  measurement.q << 1e-3 * static_cast<double>(tick), 0.1 - 4e-3 * static_cast<double>(tick);
  return measurement;
}

using Stepper = LawWithMemory<LoriaOrtegaRigid>;

Stepper stepper_of(const scenario::Scenario& scenario) {
  return {make_law<LoriaOrtegaRigid>(scenario), scenario.loop};
}

/// A copy of an outcome that stays valid after the next step.
struct Taken {
  Vector tau, nu;
  std::int64_t skipped;
  bool restarted;
};

Taken take(Stepper& stepper, std::int64_t tick) {
  const auto outcome = stepper.step(tick, ramp(tick), at_zero());
  return {outcome.command.tau, outcome.signals.value[1], outcome.skipped, outcome.restarted};
}

TEST(AnyLaw, AGapDoesNotCheatTheFilter) {
  // The result is exact for the first-order hold up to rounding: nu is of order 1 and takes at most
  // 20 steps.
  const scenario::Scenario s = scenario({"controller.filter=first_order_hold"});
  for (const std::int64_t gap : {2, 3, 7, 21}) {
    Stepper every = stepper_of(s);
    Stepper gapped = stepper_of(s);
    for (std::int64_t k = 0; k <= 5; ++k) {
      take(every, k);
      take(gapped, k);
    }
    for (std::int64_t k = 6; k < 5 + gap; ++k) take(every, k);
    const auto whole = take(every, 5 + gap);
    const auto leap = take(gapped, 5 + gap);
    EXPECT_EQ(leap.skipped, gap - 1);
    EXPECT_FALSE(leap.restarted);
    EXPECT_LT((leap.nu - whole.nu).norm(), 1e-13) << gap;
    EXPECT_LT((leap.tau - whole.tau).norm(), 1e-9) << gap;
    EXPECT_GT(whole.nu.norm(), 1) << "there is something to compare";
  }
}

TEST(AnyLaw, ALawThatDidNotKnowOfTheGapWouldSeeTwiceTheVelocity) {
  const scenario::Scenario s = scenario({"controller.filter=first_order_hold"});
  const auto usual = make_law<LoriaOrtegaRigid>(s);
  Stepper stepper = stepper_of(s), leaping = stepper_of(s);
  for (std::int64_t k = 0; k <= 20; ++k) {
    take(stepper, k);
    take(leaping, k);
  }
  const auto settled = take(stepper, 21);
  const auto leap = take(leaping, 22);
  auto memory = usual.start(ramp(0), at_zero());
  for (std::int64_t k = 0; k <= 20; ++k) memory = usual.step(memory, ramp(k), at_zero()).memory;
  const auto cheated = usual.step(memory, ramp(22), at_zero());
  // a = b, so nu equals the ramp's slope after it has settled (exp(-20) from it).
  EXPECT_NEAR(settled.nu[0], 1, 1e-8);
  EXPECT_NEAR(leap.nu[0], 1, 1e-8);
  EXPECT_GT(cheated.memory.nu[0], 1.5);
}

TEST(AnyLaw, BeginsAnewAfterTooLongAGapAndSaysSo) {
  const scenario::Scenario s = scenario({"loop.max_missed=4"});
  Stepper stepper = stepper_of(s);
  EXPECT_EQ(stepper.longest_gap(), 5);
  for (std::int64_t k = 0; k <= 20; ++k) take(stepper, k);
  EXPECT_FALSE(take(stepper, 25).restarted);
  const auto anew = take(stepper, 31);
  EXPECT_TRUE(anew.restarted);
  EXPECT_EQ(anew.skipped, 5);
  EXPECT_EQ(anew.nu, Vector::Zero(2));
}

TEST(AnyLaw, WithoutGapsIsTheLawItselfBitForBit) {
  for (const auto* mode : {"loop.mode=realtime", "loop.mode=lockstep"}) {
    const scenario::Scenario s = scenario({mode});
    const auto law = make_law<LoriaOrtegaRigid>(s);
    Stepper stepper = stepper_of(s);
    auto memory = law.start(ramp(0), at_zero());
    for (std::int64_t k = 0; k < 40; ++k) {
      const auto plain = law.step(memory, ramp(k), at_zero());
      memory = plain.memory;
      const auto outcome = take(stepper, k);
      EXPECT_TRUE(outcome.tau == plain.command.tau) << k;
      EXPECT_EQ(outcome.skipped, 0);
    }
  }
}

TEST(AnyLaw, BridgesNoGapInLockstepAndBoundedOnesInRealtime) {
  EXPECT_EQ(stepper_of(scenario({"loop.mode=lockstep"})).longest_gap(), 1);
  EXPECT_EQ(stepper_of(scenario({"loop.max_missed=1000000"})).longest_gap(), 64);
}

TEST(AnyLaw, FeedsFrictionForwardFromTheReference) {
  scenario::Scenario s =
      scenario({"controller.friction.viscous=[3, 0]", "controller.friction.coulomb=[0, 2]",
                "controller.friction.smoothing=0.5"});
  ScenarioLaw with = scenario_law(s);
  s.controller.friction = {};
  ScenarioLaw without = scenario_law(s);
  messages::ReferencePoint reference = at_zero();
  reference.v_ref << 0.25, -0.5;
  const Vector tau = with->step(0, ramp(0), reference).command.tau -
                     without->step(0, ramp(0), reference).command.tau;
  // These are differences of torques of some 300 N m.
  EXPECT_NEAR(tau[0], 3 * 0.25, 1e-12);
  EXPECT_NEAR(tau[1], 2 * std::tanh(-1.0), 1e-12);
}

/// The friction that grows with gravity's torque is taken at the reference's posture.
TEST(AnyLaw, FeedsForwardFrictionThatRisesAndThatGrowsWithTheLoad) {
  const std::string gains = "controller.gains={kp: 100, kd: 20, a: 300, b: 300";
  for (const auto& [law, more] : {std::pair<std::string, const char*>{"loria_ortega_rigid", "}"},
                                  {"loria_ortega_integral", ", ki: 1, eps_1: 0.1, eps_2: 0.01}"},
                                  {"loria_ortega_bounded", "}"}}) {
    scenario::Scenario s =
        scenario({"controller.law=" + law, gains + more, "plant.drive.torque_limit_Nm=1000",
                  "controller.friction={coulomb: [2, 1], rise: [3, -1], rise_velocity: 0.5, load: "
                  "[0.1, 0], smoothing: 0.2}"});
    ScenarioLaw with = scenario_law(s);
    s.controller.friction = {};
    ScenarioLaw without = scenario_law(s);
    messages::ReferencePoint reference = at_zero();
    reference.q_ref << 0.3, -0.2;
    reference.v_ref << 0.25, -0.5;
    const Vector tau = with->step(0, ramp(0), reference).command.tau -
                       without->step(0, ramp(0), reference).command.tau;
    const Vector g = robot::gravity_torque(rigid_model(s), reference.q_ref);
    ASSERT_GT(std::abs(g[0]), 20);
    EXPECT_NEAR(tau[0],
                (2 + 0.1 * std::abs(g[0])) * std::tanh(0.25 / 0.2) + 3 * std::tanh(0.25 / 0.5),
                1e-11)
        << law;
    EXPECT_NEAR(tau[1], std::tanh(-0.5 / 0.2) - std::tanh(-0.5 / 0.5), 1e-11) << law;
  }
}

TEST(AnyLaw, RefusesToGoBack) {
  Stepper stepper = stepper_of(scenario({}));
  take(stepper, 5);
  EXPECT_THROW(stepper.step(5, ramp(5), at_zero()), std::logic_error);
  EXPECT_THROW(stepper.step(4, ramp(4), at_zero()), std::logic_error);
}

/// The law has other gains from the tick of their reference on.
TEST(AnyLaw, TakesTheGainsOfAReferenceFromItsTickOnAndKeepsItsMemory) {
  const scenario::Scenario s = scenario({"controller.gains_may_change=true"});
  const ScenarioLaw changed = scenario_law(s), unchanged = scenario_law(s);
  const std::string gains = "kp=300,100;kd=20,5";
  const auto softer = make_law<LoriaOrtegaRigid>(with_gains(s, gains));
  auto memory = make_law<LoriaOrtegaRigid>(s).start(ramp(0), at_zero());
  for (std::int64_t k = 0; k < 30; ++k) {
    messages::ReferencePoint reference = at_zero();
    if (k >= 10) reference.gains = gains;
    const Vector tau = changed->step(k, ramp(k), reference).command.tau;
    const Vector before = unchanged->step(k, ramp(k), at_zero()).command.tau;
    if (k < 10) {
      EXPECT_EQ(tau, before) << k;
      memory = make_law<LoriaOrtegaRigid>(s).step(memory, ramp(k), at_zero()).memory;
    } else {
      const auto step = softer.step(memory, ramp(k), at_zero());
      EXPECT_EQ(tau, step.command.tau) << k;
      EXPECT_NE(tau, before) << k;
      memory = step.memory;
    }
  }
  // The scenario's gains come back. The memory equals that of the unchanged law, because a and b
  // are the same.
  EXPECT_EQ(changed->step(30, ramp(30), at_zero()).command.tau,
            unchanged->step(30, ramp(30), at_zero()).command.tau);
}

/// Prepared gains act from the tick of their reference on, and a law is built once for them.
TEST(AnyLaw, TakesPreparedGainsAtTheTickOfTheirReference) {
  const scenario::Scenario s = scenario({"controller.gains_may_change=true"});
  int built = 0;
  LawWithMemory<LoriaOrtegaRigid> prepared(
      make_law<LoriaOrtegaRigid>(s), s.loop, {}, [&](std::string_view gains) {
        ++built;
        return make_law<LoriaOrtegaRigid>(with_gains(s, gains));
      });
  const ScenarioLaw other = scenario_law(s);
  const std::array<const char*, 5> gains = {"", "kp=300,100", "kp=200,80", "", "kp=200,80"};
  for (std::int64_t k = 0; k < 50; ++k) {
    messages::ReferencePoint now = at_zero(), next = at_zero();
    now.gains = gains[static_cast<std::size_t>(k / 10)];
    next.gains = gains[static_cast<std::size_t>(std::min<std::int64_t>(k + 1, 49) / 10)];
    prepared.prepare(next);
    const int before = built;
    EXPECT_EQ(prepared.step(k, ramp(k), now).command.tau, other->step(k, ramp(k), now).command.tau)
        << k;
    EXPECT_EQ(built, before) << k;  // no step builds a law
  }
  EXPECT_EQ(built, 4);
}

/// The counts are the length of the Kalman filter's chain and the number of samples of a
/// difference.
TEST(AnyLaw, KeepsTheCountsThatItsMemoryHasTheSizeOf) {
  struct Case {
    const char *law, *gains, *softer, *other;
  };
  for (const Case& of :
       {Case{"kalman_velocity", "process_noise: 100, order: 2", "kp=200;order=2", "order=3"},
        {"numerical_difference", "samples: 2", "kp=200;samples=2", "samples=5"},
        {"difference_of_error", "samples: 2", "kp=200", "samples=1"}}) {
    const ScenarioLaw law = scenario_law(scenario({fmt::format(
        "controller={{law: {}, gains: {{kp: 400, kd: 60, {}}}, gains_may_change: true}}", of.law,
        of.gains)}));
    messages::ReferencePoint reference = at_zero();
    law->step(0, ramp(0), reference);
    reference.gains = of.softer;
    EXPECT_TRUE(law->step(1, ramp(1), reference).command.tau.allFinite()) << of.law;
    reference.gains = of.other;
    try {
      law->step(2, ramp(2), reference);
      ADD_FAILURE() << of.law;
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::protective_stop);
      EXPECT_THAT(failure.what(), testing::HasSubstr("stays as the run began"));
    }
  }
}

TEST(AnyLaw, StopsForGainsThatAreNoneOfItsOwn) {
  const auto fault = [](const std::string& gains, const char* may_change) -> std::string {
    const ScenarioLaw law = scenario_law(scenario({may_change}));
    messages::ReferencePoint reference = at_zero();
    reference.gains = gains;
    try {
      law->step(0, ramp(0), reference);
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::protective_stop);
      return failure.what();
    }
    return "";
  };
  const char* const may = "controller.gains_may_change=true";
  EXPECT_EQ(fault("kp=300,100", may), "");
  EXPECT_THAT(fault("kp=300,100", "controller.gains_may_change=false"),
              testing::HasSubstr("controller.gains_may_change is false"));
  EXPECT_THAT(fault("kp=-1", may), testing::HasSubstr("kp"));
  EXPECT_THAT(fault("ki=1", may), testing::HasSubstr("ki"));
  EXPECT_THAT(fault("kp", may), testing::HasSubstr("is not name=number"));
}

}  // namespace
}  // namespace tachless::controller
