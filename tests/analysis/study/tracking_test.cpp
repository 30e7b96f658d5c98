#include "study/tracking.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tachless::study {
namespace {

Vector vector(std::initializer_list<double> values) {
  Vector v(static_cast<Eigen::Index>(values.size()));
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
  EXPECT_EQ(first.error.first(), 0.5);
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

}  // namespace
}  // namespace tachless::study
