#include "study/verdict.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "study/measures.h"

namespace tachless::study {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

const robot::JointLabels rotary = {{"axle", "arm"}, {"rad", "rad"}, {"N m", "N m"}};

using OverTime = std::function<double(double)>;

/// Two seconds at 1 kHz, of a joint for each error.
Tracking run(const std::vector<OverTime>& errors, const OverTime& q_ref) {
  const auto n = static_cast<Eigen::Index>(errors.size());
  Tracking tracking(static_cast<int>(n));
  for (int k = 0; k < 2000; ++k) {
    const double t = 1e-3 * k;
    Vector q(n), reference(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      reference[i] = i == 0 ? q_ref(t) : 0;
      q[i] = reference[i] + errors[static_cast<std::size_t>(i)](t);
    }
    tracking.add(t, q, reference, {}, Vector::Zero(n));
  }
  return tracking;
}

/// Returns the verdict on one joint, with an encoder of 20 bits.
Verdict verdict(const OverTime& error, const OverTime& q_ref, double friction = 0,
                bool realtime = false) {
  return judge(run({error}, q_ref), {.resolution = Vector::Constant(1, 6e-6),
                                     .friction = Vector::Constant(1, friction),
                                     .stiffness = Vector::Constant(1, 100),
                                     .realtime = realtime});
}

double still(double /*t*/) { return 0; }
double five_hertz(double t) { return 0.03 * std::sin(10 * std::numbers::pi * t); }
/// By 0.5 rad within the first second.
double step(double t) { return 0.5 * std::min(t, 1.0); }
OverTime decay(double from, double per_s) {
  return [=](double t) { return from * std::exp(-per_s * t); };
}
OverTime constantly(double value) {
  return [=](double /*t*/) { return value; };
}

TEST(Verdict, OfAFastDecayIsConvergedAndSaysWhen) {
  const Verdict seen = verdict(decay(0.5, 20), still);
  EXPECT_EQ(seen.word(), "converged");
  // ln(100) / 20 = 0.230 s, to a bin of the curve.
  EXPECT_NEAR(seen.settled_s, 0.230, 0.002);
  EXPECT_THAT(text(seen, rotary), HasSubstr("settled within 0.23"));
}

TEST(Verdict, CountsSettlingFromTheMotionsEnd) {
  const auto late = [](double t) { return t < 1 ? 0.1 : 0.1 * std::exp(-20 * (t - 1)); };
  const Verdict seen = verdict(late, step);
  EXPECT_EQ(seen.word(), "converged");
  EXPECT_NEAR(seen.counted_from_s, 1, 0.002);
  // ln(0.1 / (1 % of 0.5)) / 20 = 0.150 s.
  EXPECT_NEAR(seen.settled_s, 0.150, 0.003);
  EXPECT_THAT(text(seen, rotary), HasSubstr("s of the motion's end"));
  EXPECT_EQ(text(verdict(constantly(1e-5), step), rotary), "converged when the motion ends");
  EXPECT_EQ(text(verdict(constantly(1e-5), five_hertz), rotary), "converged throughout");
}

/// A polynomial of degree 9 that rests at both ends is within 1e-6 of its end for 2.4 % of its
/// time.
TEST(Verdict, CountsSettlingFromTheEndOfAMotionThatEndsSmoothly) {
  const auto smooth = [](double t) {
    const double s = std::min(t, 1.0), s5 = s * s * s * s * s;
    return 0.5 + 0.1 * s5 * (126 + s * (-420 + s * (540 + s * (-315 + s * 70))));
  };
  // Within 1e-12 of its end for 0.15 %; a tick.
  EXPECT_NEAR(verdict(decay(0.5, 20), smooth).counted_from_s, 1, 0.0025);
}

TEST(Verdict, DoesNotDependOnHowBadlyItBegan) {
  // The same small error after a motion, from the reference and from beside it.
  EXPECT_EQ(verdict(constantly(1e-4), step).word(), "converged");
  EXPECT_EQ(verdict([](double t) { return 1e-4 + std::exp(-20 * t); }, step).word(), "converged");
  // Three counts are no error, whatever the motion.
  EXPECT_EQ(verdict(constantly(1.7e-5), still).word(), "converged");
  EXPECT_NE(verdict(constantly(1.9e-5), still).word(), "converged");
}

TEST(Verdict, TellsWhatTheMotionMakesFromWhatDecays) {
  const auto lag = [](double share) {
    return [=](double t) { return share * 2 * five_hertz(t + 0.03); };
  };
  EXPECT_EQ(verdict(lag(0.04), five_hertz).word(), "lags");
  const Verdict lags = verdict(lag(0.2), five_hertz);
  EXPECT_EQ(lags.word(), "lags");
  EXPECT_THAT(text(lags, rotary), HasSubstr(" 20 % of its scale; the motion makes it"));
  // Without a motion the scale is the error itself.
  Yardsticks yardsticks;
  yardsticks.disturbed = [](double from_s, double to_s) { return from_s < 2 && to_s > 1; };
  const Verdict disturbed = judge(run({five_hertz}, still), yardsticks);
  EXPECT_EQ(disturbed.word(), "lags");
  EXPECT_THAT(text(disturbed, rotary), HasSubstr(" 100 % of its scale; a disturbance makes it"));
  // Without a disturbance only the loop itself can make a swing at rest.
  EXPECT_EQ(verdict(five_hertz, still).word(), "oscillates");
  EXPECT_EQ(verdict(decay(0.5, 0.7), still).word(), "lags");
}

TEST(Verdict, OfAConstantErrorIsThatItRestsBeside) {
  const Verdict seen = verdict(constantly(0.05), step);
  EXPECT_EQ(seen.word(), "rests_beside");
  EXPECT_THAT(text(seen, rotary), HasSubstr("rests 0.05 rad beside"));
  EXPECT_THAT(text(seen, rotary),
              HasSubstr("about 5 N m that the law does not know, over kp = 100"));
  // Reached in the run, with a time constant of a quarter of it.
  const auto reached = [](double t) { return 0.05 + 0.05 * std::exp(-2 * t); };
  EXPECT_EQ(verdict(reached, still).word(), "rests_beside");
  // Nearly constant, as the run is a twentieth of its time constant.
  EXPECT_EQ(verdict(decay(0.5, 0.025), still).word(), "lags");
  // One that neither moves nor starts beside its reference is measured by its largest error.
  EXPECT_EQ(verdict([](double t) { return 0.01 * (1 - std::exp(-20 * t)); }, still).word(),
            "rests_beside");
}

TEST(Verdict, OfAJointThatFrictionHoldsIsStuck) {
  const auto held = [](double t) { return t < 0.5 ? 0.0 : step(0.5) - step(t); };
  const Verdict seen = verdict(held, step, 30);
  EXPECT_EQ(seen.word(), "rests_beside");
  EXPECT_EQ(seen.cause, Cause::friction);
  EXPECT_THAT(text(seen, rotary), HasSubstr("holds it up to F_c/kp = 0.3 rad"));
  // While the reference moves on, too.
  EXPECT_EQ(verdict([](double t) { return 0.01 - five_hertz(t); }, five_hertz, 30).word(),
            "rests_beside");
  // And where it slips at each turn of the motion.
  const auto slips = [](double t) {
    return 0.004 * std::round(five_hertz(t) / 0.06) - five_hertz(t);
  };
  EXPECT_EQ(verdict(slips, five_hertz, 30).word(), "rests_beside");
  // A joint that moves as little but never rests is not held by friction.
  const Verdict moves = verdict([](double t) { return -0.9 * five_hertz(t); }, five_hertz, 30);
  EXPECT_EQ(moves.word(), "lags");
  EXPECT_THAT(text(moves, rotary), HasSubstr("the motion, or dry friction, makes it"));
  // Without friction something else holds it.
  EXPECT_EQ(verdict(held, step).word(), "rests_beside");
}

TEST(Verdict, OfASwingThatTheReferenceDoesNotAskForIsALimitCycle) {
  const auto swing = [](double t) { return 0.02 * std::sin(2 * std::numbers::pi * 60 * t); };
  for (const auto& reference : {still, five_hertz}) {
    const Verdict seen = verdict(swing, reference);
    EXPECT_EQ(seen.word(), "oscillates");
    EXPECT_NEAR(seen.frequency_hz, 60, 4);
    EXPECT_NEAR(seen.error, 0.02, 1e-4);
  }
  // One that decays is none, and one of some encoder counts is none.
  EXPECT_NE(verdict([&](double t) { return swing(t) * std::exp(-2 * t); }, still).word(),
            "oscillates");
  EXPECT_NE(verdict([&](double t) { return 1e-3 * swing(t); }, still).word(), "oscillates");
}

TEST(Verdict, OfAGrowingErrorIsDiverging) {
  const Verdict seen = verdict([](double t) { return 1e-3 * std::exp(4 * t); }, still);
  EXPECT_EQ(seen.word(), "diverging");
  EXPECT_THAT(text(seen, rotary), HasSubstr("diverging: the error of joint 1 (axle) has grown"));
  // Slowly too, and while it is still small: a swing that the motion does not ask for.
  const auto slowly = [](double t) {
    return 1e-5 * std::exp(2 * t) * std::sin(2 * std::numbers::pi * 200 * t);
  };
  EXPECT_EQ(verdict(slowly, five_hertz).word(), "diverging");
  // The encoder makes one of few counts, which is larger by chance in each quarter.
  const auto counted = [](double t) {
    const double counts = t < 0.5 ? 5 : t < 1 ? 4 : t < 1.5 ? 6 : 9;
    return 3e-6 * counts * std::sin(2 * std::numbers::pi * 200 * t);
  };
  EXPECT_EQ(verdict(counted, five_hertz).word(), "converged");
  // In real time late commands can make a small one; a larger one they do not.
  EXPECT_EQ(verdict(slowly, five_hertz, 0, true).word(), "converged");
  const auto larger = [&](double t) { return 100 * slowly(t); };
  EXPECT_EQ(verdict(larger, five_hertz, 0, true).word(), "diverging");
  // The motion that comes late makes an error that comes late.
  const auto late = [](double t) { return t < 1.5 ? 0 : 0.3 * (t - 1.5); };
  EXPECT_NE(verdict([&](double t) { return 0.3 * late(t); }, late).word(), "diverging");
}

TEST(Verdict, OfASwingThatDecaysOnASlowErrorIsThatOfTheError) {
  // The fast swing turns the slow error ever more seldom as it decays. The part between two turns
  // is more and more the slow error's, and grows.
  const auto motion = [](double t) { return 0.1 * std::sin(2 * std::numbers::pi * t); };
  const auto swing = [&](double per_s) {
    return [=](double t) {
      const double fast = 6e-5 * std::exp(-per_s * t) * std::sin(2 * std::numbers::pi * 20 * t);
      return 5e-3 * motion(t - 0.1) + fast;
    };
  };
  for (const double per_s : {0.2, 0.4, 0.6, 1.0, 2.0}) {
    EXPECT_EQ(verdict(swing(per_s), motion).word(), "converged") << per_s;
  }
  // One that grows by 40 % from quarter to quarter, and is less than the slow error.
  EXPECT_EQ(verdict(swing(-0.67), motion).word(), "diverging");
}

TEST(Verdict, OfAnErrorBeyondTheMotionAndItsStartIsNeverThatTheMotionMakesIt) {
  const auto swing = [](const OverTime& size) {
    return [=](double t) { return size(t) * std::sin(2 * std::numbers::pi * 13 * t); };
  };
  // 13 Hz are too few turns more than those of the motion to be no swing of the motion's.
  const auto settled = [](double t) { return 1.4 * std::min(1.0, 0.05 + t); };
  const Verdict seen = verdict(swing(settled), five_hertz);
  EXPECT_EQ(seen.word(), "oscillates");
  EXPECT_THAT(text(seen, rotary), HasSubstr("swings by 1.4 rad at 1"));
  // Smaller than in the quarter before, but not than at first.
  const auto uneven = [&](double t) { return settled(t) * (t > 1.5 ? 0.9 : 1); };
  EXPECT_EQ(verdict(swing(uneven), five_hertz).word(), "oscillates");
  EXPECT_EQ(verdict(swing([](double t) { return 0.02 * std::exp(t); }), five_hertz).word(),
            "diverging");
  EXPECT_EQ(verdict(swing([](double t) { return 1.4 * std::exp(-t); }), five_hertz).word(), "lags");
  // Thrown off by a start at another speed, by more than the motion, and slowly on its way back.
  const auto thrown = [](double t) {
    return 0.13 * (1 - std::exp(-20 * t)) * std::exp(-0.2 * t) + 0.1 * five_hertz(t);
  };
  EXPECT_EQ(verdict(thrown, five_hertz).word(), "lags");
  EXPECT_EQ(verdict([](double t) { return 0.13 + 0.1 * five_hertz(t); }, five_hertz).word(),
            "rests_beside");
}

TEST(Verdict, OfAJointAtItsLimitForMostOfTheRunIsSaturated) {
  const Tracking tracking = run({decay(0.2, 10)}, still);
  EXPECT_EQ(judge(tracking, {.saturated_share = {0.45}}).word(), "converged");
  EXPECT_EQ(judge(tracking, {.saturated_share = {NAN}}).saturated_share, 0) << "of no tick";
  const Verdict seen = judge(tracking, {.saturated_share = {0.91}});
  EXPECT_EQ(seen.word(), "saturated");
  EXPECT_THAT(text(seen, rotary), HasSubstr("in 91 % of ticks"));
}

TEST(Verdict, IsThatOfTheWorstJoint) {
  const Verdict seen = judge(run({decay(0.5, 20), decay(0.5, 0.7)}, still), {});
  EXPECT_EQ(seen.word(), "lags");
  EXPECT_THAT(text(seen, rotary), HasSubstr("at joint 2 (arm)"));
  // A joint that is to rest where another one moves is measured by that motion.
  EXPECT_EQ(
      judge(run({decay(0.5, 20), [](double t) { return 1e-3 * (1 - std::exp(-20 * t)); }}, step),
            {})
          .word(),
      "converged");
  // A joint that starts next to its place is measured by that motion too. A small distance at the
  // start is no scale for the errors that the other joints make.
  const OverTime coupled = [](double t) { return 1e-7 + 3e-5 * (t < 0.5 ? 0.1 : t); };
  EXPECT_EQ(judge(run({decay(0.5, 20), coupled}, step), {}).word(), "converged");
}

TEST(Verdict, DoesNotJudgeAFewTicks) {
  EXPECT_EQ(judge(Tracking(1), {}).outcome, Outcome::not_judged);
}

TEST(Verdict, FailuresAreFromRestingBesideOn) {
  for (const Outcome good : {Outcome::converged, Outcome::lags, Outcome::not_judged}) {
    EXPECT_FALSE(bad(good));
  }
  for (const Outcome fault : {Outcome::rests_beside, Outcome::saturated, Outcome::oscillates,
                              Outcome::diverging, Outcome::stopped}) {
    EXPECT_TRUE(bad(fault));
  }
}

// ---- real runs ----------------------------------------------------------------------------------

Verdict of_run(std::vector<std::string> overrides, const std::string& name = "practical_rigid") {
  overrides.insert(overrides.begin(), {"plant.mechanics=native", "plant.integrator.accuracy=1e-6"});
  return measure(
             scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/" + name + ".yaml", overrides))
      ->verdict;
}

TEST(VerdictOfARun, IsStuckWithStiffFrictionAndSoftGains) {
  const Verdict seen =
      of_run({"controller.gains.kp=1", "plant.drive.coulomb_friction_Nm=50",
              "reference={hold: {position_rad: [0.5, 0.5]}}", "loop.duration_s=1"});
  EXPECT_EQ(seen.word(), "rests_beside") << text(seen, rotary);
}

TEST(VerdictOfARun, IsStuckWhereFrictionLetsTheJointSlipAtTimes) {
  const Verdict seen =
      of_run({"controller.gains.kp=1", "plant.drive.coulomb_friction_Nm=50", "loop.duration_s=1"});
  EXPECT_EQ(seen.word(), "rests_beside") << text(seen, rotary);
  EXPECT_EQ(seen.joint, 1U);
}

/// study_delay with the gains that a sweep over its period gives each law.
TEST(VerdictOfARun, IsBadBeyondTheLargestStablePeriodThoughItStaysBounded) {
  const auto at = [](const std::string& law, const std::string& gains, double period_s) {
    const int ticks = static_cast<int>(2 / period_s);
    return of_run({"controller.gains={kd: [470.8, 32.21], kp: [7396, 505.9]" + gains + "}",
                   "controller.law=" + law, fmt::format("loop.period_s={:.9g}", period_s),
                   fmt::format("loop.duration_s={:.12g}", ticks * period_s)},
                  "study_delay");
  };
  const std::string filter = ", a: 314.2, b: 314.2";
  EXPECT_FALSE(bad(at("loria_ortega_rigid", filter, 6.6e-3).outcome));  // 0.96 of its limit
  EXPECT_FALSE(bad(at("wen_bayard", "", 8.4e-3).outcome));              // 0.96
  for (const double period_s : {7.952707e-3, 9.274009e-3}) {            // 1.15 and 1.34
    const Verdict seen = at("loria_ortega_rigid", filter, period_s);
    EXPECT_EQ(seen.word(), "oscillates") << text(seen, rotary);
  }
  EXPECT_TRUE(bad(at("wen_bayard", "", 10.814837e-3).outcome));                  // 1.22
  EXPECT_TRUE(bad(at("numerical_difference", ", samples: 6", 4.3e-3).outcome));  // 1.31
}

/// study_flexibility's rigid law: a swing of the springs that takes 3 s to decay.
TEST(VerdictOfARun, IsConvergedWhileTheSpringsStillSwing) {
  for (const char* stiffness : {"1.78e5", "2.4e5", "4.4e5"}) {
    const Verdict seen =
        of_run({"controller.law=loria_ortega_rigid",
                "controller.gains={kd: [188.3, 12.88], kp: [1183, 80.96], a: 125.7, b: 125.7}",
                std::string("robot.joints.flexible.stiffness_Nm_per_rad=") + stiffness},
               "study_flexibility");
    EXPECT_EQ(seen.word(), "converged") << stiffness << " " << text(seen, rotary);
  }
}

TEST(VerdictOfARun, RestsBesideWithAnUnknownMass) {
  const Verdict seen =
      of_run({"reference={hold: {position_rad: [0.5, 0]}}", "plant.initial.position_rad=[0.5, 0]",
              "plant.payload.mass_kg=2", "loop.duration_s=2"});
  EXPECT_EQ(seen.word(), "rests_beside") << text(seen, rotary);
}

TEST(VerdictOfARun, IsNoFailureWhereItIsFarTooShortForItsGains) {
  const Verdict seen = of_run({"controller.gains.kp=3", "loop.duration_s=0.2"});
  EXPECT_EQ(seen.word(), "lags") << text(seen, rotary);
}

TEST(VerdictOfARun, IsOutsideWhereItStartsBeyondTheBreakOff) {
  EXPECT_EQ(of_run({"plant.initial.position_rad=[101, 0]"}).word(), "stopped");
}

// ---- runs whose word was once false -------------------------------------------------------------

Verdict of_case(const std::string& name, const std::vector<std::string>& overrides = {}) {
  return measure(
             scenario::load_scenario(
                 TACHLESS_SOURCE_DIR "/tests/analysis/study/cases/" + name + ".yaml", overrides))
      ->verdict;
}

TEST(VerdictOfACase, RestsBesideThoughNoiseShakesIt) {
  for (const char* noise : {"0.005", "0"}) {
    const Verdict seen =
        of_case("lags_at_rest", {std::string("plant.encoder.noise_std_rad=") + noise});
    EXPECT_EQ(seen.word(), "rests_beside") << noise << " " << text(seen, rotary);
  }
}

TEST(VerdictOfACase, IsConvergedWhereOnlyNoiseMakesTheError) {
  for (const char* seed : {"1", "2", "3", "4"}) {
    const Verdict seen =
        of_case("noise_is_no_limit_cycle", {std::string("plant.encoder.seed=") + seed});
    EXPECT_EQ(seen.word(), "converged") << text(seen, rotary);
  }
}

TEST(VerdictOfACase, LagsWhereThePeriodOfTheReferenceIsAsTheOneBefore) {
  for (const char* seconds : {"2", "3", "6", "12"}) {
    const Verdict seen =
        of_case("forced_is_not_diverging", {std::string("loop.duration_s=") + seconds});
    EXPECT_EQ(seen.word(), "lags") << seconds << " " << text(seen, rotary);
    EXPECT_EQ(seen.cause, Cause::motion);
  }
  for (const char* seconds : {"3", "9"}) {
    const Verdict seen =
        of_case("forced_is_no_limit_cycle", {std::string("loop.duration_s=") + seconds});
    EXPECT_EQ(seen.word(), "lags") << seconds << " " << text(seen, rotary);
  }
}

TEST(VerdictOfACase, StillSettlesWhereTheLoopNeedsLongerThanTheRun) {
  const Verdict seen =
      of_run({"reference={hold: {position_rad: [0, 0]}}", "loop.period_s=1.644e-5",
              "loop.duration_s=0.06576", "plant.initial.position_rad=[1e-4, 1e-4]"},
             "paper_flexible");
  EXPECT_EQ(seen.word(), "lags") << text(seen, rotary);
  EXPECT_EQ(seen.cause, Cause::settling);
  EXPECT_THAT(text(seen, rotary),
              HasSubstr("; the loop settles in 4.4 s, the run gave it 0.066 s"));
}

TEST(Verdict, SaysThatAReferenceWhichWasToMoveDidNot) {
  Yardsticks yardsticks;
  yardsticks.held = false;
  EXPECT_THAT(text(judge(run({decay(0.5, 20)}, still), yardsticks), rotary),
              HasSubstr("the reference did not move in this run"));
  EXPECT_THAT(text(judge(run({decay(0.5, 20)}, step), yardsticks), rotary),
              Not(HasSubstr("did not move")));
  yardsticks.held = true;
  EXPECT_THAT(text(judge(run({decay(0.5, 20)}, still), yardsticks), rotary),
              Not(HasSubstr("did not move")));
}

}  // namespace
}  // namespace tachless::study
