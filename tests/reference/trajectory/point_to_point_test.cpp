#include "reference/trajectory/point_to_point.h"

#include "tests/reference/trajectory/derivatives.h"

namespace tachless::reference::trajectory {
namespace {

PointToPoint example() {
  PointToPoint made;
  made.from_rad = Vector::LinSpaced(3, -0.5, 1);
  made.to_rad = Vector::LinSpaced(3, 2, -0.25);
  made.start_s = 0.3;
  made.duration_s = 0.8;
  return made;
}

TEST(PointToPoint, IsExactlyAtBothEndsBeforeAndAfter) {
  const PointToPoint example_ = example();
  for (const double t : {0.0, 0.2, 0.3}) {
    EXPECT_EQ(example_.at(t).q_ref, example_.from_rad) << t;
    expect_at_rest(example_.at(t), 0);
  }
  for (const double t : {1.1, 1.100001, 5.0}) {
    EXPECT_EQ(example_.at(t).q_ref, example_.to_rad) << t;
  }
  expect_at_rest(example_.at(1.2), 0);
  // (1.1 - 0.3) / 0.8 may miss 1 by one rounding; snap is 15120 u / T^4 there.
  expect_at_rest(example_.at(1.1), 15120 * 2.5 * 2.3e-16 / std::pow(0.8, 4));
}

TEST(PointToPoint, EachDerivativeIsThatOfTheOneBefore) {
  const PointToPoint example_ = example();
  const double step = 0.8 * 2e-3;
  // Only the position has a ninth derivative, 9! 70 way / T^9; the rest is of degree 8 or less.
  const double first = std::pow(step, 8) / 630 * 362880.0 * 70 * 2.5 / std::pow(0.8, 9);
  for (int i = 1; i < 100; ++i) {
    const double t = 0.3 + 0.8 * (0.01 + 0.0098 * i);
    expect_derivatives_of_each_other(example_, t, step, {first, 0, 0, 0});
  }
}

TEST(PointToPoint, IsTheDegreeNinePolynomial) {
  PointToPoint unit;
  unit.from_rad = Vector::Zero(1);
  unit.to_rad = Vector::Ones(1);
  for (int i = 0; i <= 20; ++i) {
    const double s = i / 20.0;
    const double p = 126 * std::pow(s, 5) - 420 * std::pow(s, 6) + 540 * std::pow(s, 7) -
                     315 * std::pow(s, 8) + 70 * std::pow(s, 9);
    // The power form sums terms of up to 540, each rounded.
    EXPECT_NEAR(unit.at(s).q_ref[0], p, 5 * 540 * 2.3e-16) << s;
  }
}

TEST(PointToPoint, IsSymmetricAboutItsMiddle) {
  const PointToPoint example_ = example();
  const Vector sum = example_.from_rad + example_.to_rad;
  for (const double d : {0.01, 0.1, 0.25, 0.39}) {
    const Vector both = example_.at(0.7 - d).q_ref + example_.at(0.7 + d).q_ref;
    EXPECT_LE((both - sum).lpNorm<Eigen::Infinity>(), 1e-14) << d;  // speed <= 8, time rounded
  }
}

}  // namespace
}  // namespace tachless::reference::trajectory
