#include "study/tracking.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace tachless::study {
namespace {

using ::testing::HasSubstr;

robot::Vector vector(std::initializer_list<double> values) {
  robot::Vector v(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), v.data());
  return v;
}

TEST(Tracking, GivesPeakRmsAndFinalOfEachJointsError) {
  Tracking tracking(2);
  tracking.add(0, vector({0.5, 1}), vector({0, 1}), {}, vector({10, -4}));
  tracking.add(1, vector({-1.0, 1}), vector({0, 1}), {}, vector({-30, -4}));
  tracking.add(2, vector({0.25, 1}), vector({0.5, 1}), {}, vector({0, -4}));
  const JointTracking& first = tracking.joints()[0];
  EXPECT_EQ(first.error.peak(), 1.0);
  EXPECT_EQ(first.error.final(), -0.25);
  // One rounding per sum, product and root: a few ulps.
  EXPECT_DOUBLE_EQ(first.error.rms(), std::sqrt((0.25 + 1 + 0.0625) / 3));
  EXPECT_EQ(first.torque.peak(), 30);
  EXPECT_DOUBLE_EQ(first.torque.rms(), std::sqrt(1000.0 / 3));
  EXPECT_EQ(tracking.joints()[1].error.peak(), 0);
  EXPECT_EQ(tracking.joints()[1].torque.rms(), 4);
  EXPECT_EQ(tracking.num_ticks(), 3);
  EXPECT_FALSE(tracking.has_motors());
}

TEST(Tracking, OfNoTickHasNoErrorAndNoPoints) {
  const Tracking tracking(1);
  EXPECT_EQ(tracking.joints()[0].error.rms(), 0);
  EXPECT_TRUE(tracking.joints()[0].q.points().empty());
}

TEST(Tracking, RefusesAVectorOfAnotherLength) {
  Tracking tracking(2);
  EXPECT_THROW(tracking.add(0, vector({0}), vector({0, 0}), {}, vector({0, 0})), std::logic_error);
  EXPECT_THROW(tracking.add(0, vector({0, 0}), vector({0, 0}), vector({1}), vector({0, 0})),
               std::logic_error);
}

const robot::JointLabels rotary = {{"axle"}, {"rad"}, {"N m"}};

/// Two seconds at 1 kHz, of one joint.
Tracking run(const std::function<double(double)>& error,
             const std::function<double(double)>& q_ref) {
  Tracking tracking(1);
  for (int k = 0; k < 2000; ++k) {
    const double t = 1e-3 * k;
    robot::Vector q(1), reference(1), tau(1);
    reference << q_ref(t);
    q << reference[0] + error(t);
    tau << 0;
    tracking.add(t, q, reference, {}, tau);
  }
  return tracking;
}

double still(double /*t*/) { return 0; }
double five_hertz(double t) { return 0.03 * std::sin(10 * std::numbers::pi * t); }

TEST(Observed, CallsAFastDecayConvergedAndSaysWhen) {
  const Observed seen = observe(run([](double t) { return 0.5 * std::exp(-20 * t); }, still), {});
  EXPECT_EQ(seen.outcome, Outcome::converged);
  // ln(100) / 20 = 0.230 s, to a bin of the curve.
  EXPECT_NEAR(seen.settled_s, 0.230, 0.002);
  EXPECT_FALSE(seen.bad());
  EXPECT_THAT(text(seen, rotary), HasSubstr("settled within 0.23"));
}

TEST(Observed, ASlowDecayAndAnErrorOfTheMotionAreNoFailure) {
  EXPECT_EQ(observe(run([](double t) { return 0.5 * std::exp(-0.7 * t); }, still), {}).outcome,
            Outcome::followed);
  const auto tracking_error = [](double t) { return 0.1 * five_hertz(t + 0.03); };
  EXPECT_EQ(observe(run(tracking_error, five_hertz), {}).outcome, Outcome::followed);
}

TEST(Observed, ASwingThatTheReferenceDoesNotAskForIsALimitCycle) {
  const auto swing = [](double t) { return 0.02 * std::sin(2 * std::numbers::pi * 60 * t); };
  for (const auto& reference : {still, five_hertz}) {
    const Observed seen = observe(run(swing, reference), {});
    EXPECT_EQ(seen.outcome, Outcome::limit_cycle);
    EXPECT_TRUE(seen.bad());
    EXPECT_NEAR(seen.frequency_hz, 60, 4);
    EXPECT_NEAR(seen.amplitude, 0.02, 1e-4);
  }
  // One that decays is none, and one of some encoder counts is none.
  const auto decaying = [&](double t) { return swing(t) * std::exp(-2 * t); };
  EXPECT_NE(observe(run(decaying, still), {}).outcome, Outcome::limit_cycle);
  const auto counts = [&](double t) { return 1e-3 * swing(t); };
  EXPECT_NE(observe(run(counts, still), {}).outcome, Outcome::limit_cycle);
}

TEST(Observed, CallsAGrowingErrorDivergence) {
  const Observed seen = observe(run([](double t) { return 1e-3 * std::exp(4 * t); }, still), {});
  EXPECT_EQ(seen.outcome, Outcome::diverging);
  EXPECT_THAT(text(seen, rotary), HasSubstr("diverging: the error of joint 1 (axle) has grown"));
}

TEST(Observed, CallsAJointThatIsAtItsLimitForMostOfTheRunSaturated) {
  const auto error = [](double /*t*/) { return 0.2; };
  EXPECT_EQ(observe(run(error, still), {900}).outcome, Outcome::followed);
  const Observed seen = observe(run(error, still), {1820});
  EXPECT_EQ(seen.outcome, Outcome::saturated);
  EXPECT_THAT(text(seen, rotary), HasSubstr("in 91 % of ticks"));
}

TEST(Observed, DoesNotJudgeAFewTicks) {
  EXPECT_EQ(observe(Tracking(1), {}).outcome, Outcome::not_judged);
}

}  // namespace
}  // namespace tachless::study
