#include "controller/law/filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "tests/controller/law/velocity_error.h"
#include "tests/support/rounding.h"

namespace tachless::controller::law::filter_test {
namespace {

constexpr std::array all_kinds{Discretisation::first_order_hold, Discretisation::tustin,
                               Discretisation::backward_euler, Discretisation::zero_order_hold};

Vector one(double x) { return Vector::Constant(1, x); }

/// Returns nu after each of n + 1 samples of e(t).
std::vector<double> outputs(Discretisation kind, double a, double b, double h, int n,
                            const std::function<double(double)>& e,
                            FilterStart start = FilterStart::at_error) {
  const Filter filter(one(a), one(b), kind, start, h);
  Filter::Memory memory = filter.start(one(e(0)));
  std::vector<double> nu;
  for (int k = 0; k <= n; ++k) {
    memory = filter.step(memory, one(e(k * h)));
    nu.push_back(memory.nu[0]);
  }
  return nu;
}

TEST(Filter, FirstOrderHoldIsExactOnARamp) {
  const double a = 37, b = 90, h = 0.013, slope = -2.5;
  const auto nu = outputs(Discretisation::first_order_hold, a, b, h, 50,
                          [&](double t) { return 0.4 + slope * t; });
  for (int k = 0; k <= 50; ++k) {
    const double exact = slope * b / a * (1 - std::exp(-a * h * k));
    EXPECT_NEAR(nu[k], exact, 200 * eps * std::abs(slope) * b / a) << k;  // 50 rounded steps
  }
}

TEST(Filter, FirstOrderHoldIsExactBetweenSamplesOfABrokenLine) {
  // Two samples per piece are compared with one; the corners lie on samples in both.
  const double a = 11, b = 5, h = 0.1;
  const auto line = [](double t) { return t < 0.45 ? t : 0.9 - t; };
  const auto coarse = outputs(Discretisation::first_order_hold, a, b, h / 2, 20, line);
  const auto fine = outputs(Discretisation::first_order_hold, a, b, h / 4, 40, line);
  for (int k = 0; k <= 20; ++k) {
    EXPECT_NEAR(coarse[k], fine[2 * k], 200 * eps) << k;
  }
}

TEST(Filter, ZeroOrderHoldIsExactOnAStep) {
  const double a = 37, b = 90, h = 0.013;
  const auto nu = outputs(Discretisation::zero_order_hold, a, b, h, 50,
                          [](double t) { return t > 0 ? 1.0 : 0.0; });
  for (int k = 1; k <= 50; ++k) {
    // The first sample after the step contains it and answers it fully.
    EXPECT_NEAR(nu[k], b * std::exp(-a * h * (k - 1)), 200 * eps * b) << k;
  }
}

TEST(Filter, TustinIsTheTransferFunctionAtThePrewarpedFrequency) {
  // z = exp(i w h) in b s / (s + a), s = (2 / h) (z - 1) / (z + 1).
  const double a = 60, b = 40, h = 0.01, w = 70;
  const auto nu =
      outputs(Discretisation::tustin, a, b, h, 400, [&](double t) { return std::sin(w * t); });
  const double warped = 2 / h * std::tan(w * h / 2);
  const double gain = b * warped / std::hypot(a, warped);
  const double lead = std::atan2(a, warped);
  for (int k = 300; k <= 400; ++k) {  // the start has decayed by 1e-70
    EXPECT_NEAR(nu[k], gain * std::sin(w * k * h + lead), 1e-11) << k;  // w k h to 3e2 eps rad
  }
}

TEST(Filter, BackwardEulerSatisfiesItsOwnEquation) {
  const double a = 60, b = 40, h = 0.01;
  const auto e = [](double t) { return std::cos(9 * t) + t * t; };
  const auto nu = outputs(Discretisation::backward_euler, a, b, h, 100, e);
  for (int k = 1; k <= 100; ++k) {
    const double edot = (e(k * h) - e(k * h - h)) / h;
    EXPECT_NEAR((nu[k] - nu[k - 1]) / h, -a * nu[k] + b * edot, 1e-10) << k;  // eps / h * 1e3
  }
}

TEST(Filter, AllKindsApproachTheContinuousFilterWithTheirOrder) {
  // e = sin(w t): nu in closed form.
  const double a = 20, b = 30, w = 8, t_end = 0.5;
  const double c = b * w / (a * a + w * w);
  const double exact =
      c * (a * std::cos(w * t_end) + w * std::sin(w * t_end)) - c * a * std::exp(-a * t_end);
  const auto error = [&](Discretisation kind, int n) {
    return std::abs(
        outputs(kind, a, b, t_end / n, n, [&](double t) { return std::sin(w * t); }).back() -
        exact);
  };
  for (const Discretisation kind : all_kinds) {
    const bool second_order =
        kind == Discretisation::first_order_hold || kind == Discretisation::tustin;
    const double order = std::log2(error(kind, 2000) / error(kind, 4000));
    // Higher orders in h change the observed order by about a h = 0.005.
    EXPECT_NEAR(order, second_order ? 2 : 1, 0.03) << static_cast<int>(kind);
  }
}

TEST(Filter, ZeroOrderHoldInflatesTheGainAsDocumented) {
  // On a ramp nu tends to b h / (1 - phi) instead of b / a.
  const double a = 1000, b = 1000, h = 1e-3;
  const auto nu =
      outputs(Discretisation::zero_order_hold, a, b, h, 200, [](double t) { return t; });
  EXPECT_NEAR(nu.back(), a * h / (1 - std::exp(-a * h)), 1e-12);  // 200 rounded steps of e
  EXPECT_NEAR(nu.back(), 1.58, 0.01);
}

TEST(Filter, StartsAtZeroOutputByDefault) {
  for (const Discretisation kind : all_kinds) {
    const auto nu = outputs(kind, 3, 7, 0.1, 20, [](double) { return 5.0; });
    for (const double output : nu) {
      EXPECT_EQ(output, 0);  // a constant has no derivative
    }
  }
}

TEST(Filter, StartsWithTheKickOfTheRawTransferFunctionWhenAsked) {
  for (const Discretisation kind : all_kinds) {
    const double a = 3, b = 7, h = 0.1;
    const auto nu = outputs(
        kind, a, b, h, 1, [](double) { return 5.0; }, FilterStart::zero);
    EXPECT_NEAR(nu[0], b * 5, 20 * eps * b * 5);
    EXPECT_NEAR(nu[1], filter_coefficients(kind, a, b, h).phi * b * 5, 20 * eps * b * 5);
  }
}

TEST(Filter, TakesJointsOneByOne) {
  Vector a(2), b(2), e(2);
  a << 10, 1000;
  b << 20, 300;
  e << 1, -2;
  const Filter both(a, b, Discretisation::tustin, FilterStart::at_error, 1e-3);
  const Filter second(one(1000), one(300), Discretisation::tustin, FilterStart::at_error, 1e-3);
  Filter::Memory pair = both.start(Vector::Zero(2));
  Filter::Memory single = second.start(one(0));
  for (int k = 1; k < 10; ++k) {
    pair = both.step(pair, k * e);
    single = second.step(single, one(-2.0 * k));
    EXPECT_EQ(pair.nu[1], single.nu[0]);
  }
}

TEST(Filter, DerivativeIsTheContinuousEquation) {
  const Filter filter(one(10), one(20), Discretisation::tustin, FilterStart::at_error, 1e-3);
  EXPECT_EQ(filter.derivative(one(3), one(-2))[0], -10 * 3 + 20 * -2);
}

TEST(Filter, RefusesWhatIsNotPositive) {
  const auto make = [](double a, double b, double h) {
    return Filter(one(a), one(b), Discretisation::tustin, FilterStart::at_error, h);
  };
  EXPECT_NO_THROW(make(1, 1, 1));
  EXPECT_THROW(make(0, 1, 1), std::invalid_argument);
  EXPECT_THROW(make(1, -1, 1), std::invalid_argument);
  EXPECT_THROW(make(1, 1, 0), std::invalid_argument);
  EXPECT_THROW(make(std::nan(""), 1, 1), std::invalid_argument);
}

/// The dirty derivative of a position as an estimate of velocity.
struct DirtyDerivative {
  Filter filter;

  [[nodiscard]] Filter::Memory start(const Vector& q,
                                     const messages::ReferencePoint& /*reference*/) const {
    return filter.start(q);
  }
  [[nodiscard]] Filter::Memory step(const Filter::Memory& memory, const Vector& q) const {
    return filter.step(memory, q);
  }
  [[nodiscard]] static Vector velocity(const Filter::Memory& memory) { return memory.nu; }
};

/// The value is from an independent simulation; the tests of other estimators hold their values.
TEST(Filter, OfAPositionHasTheVelocityErrorThatCountsAndLagGive) {
  double least = 1;
  for (double a = 100; a < 1e4; a *= 1.2) {
    const DirtyDerivative estimator{Filter(
        vector(a, a), vector(a, a), Discretisation::first_order_hold, FilterStart::at_error, 1e-3)};
    least = std::min(least, velocity_error(estimator));
  }
  EXPECT_NEAR(least, 0.034, 0.0034);
}

}  // namespace
}  // namespace tachless::controller::law::filter_test
