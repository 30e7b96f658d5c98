#include "robot/jet.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"

namespace tachless::robot {
namespace {

/// A function of one variable with its derivatives worked out by hand.
struct Elementary {
  std::string name;
  std::function<Jet2(const Jet2&)> jet;
  std::function<double(double)> f, df, ddf;
  std::vector<double> at;
};

const std::vector<Elementary>& elementary_functions() {
  using D = double;
  static const std::vector<double> all{-2.5, -0.7, 0.0, 0.3, 1.9}, positive{0.2, 0.9, 3.7};
  static const std::vector<Elementary> list{
      {"sin", [](const Jet2& x) { return sin(x); }, [](D x) { return std::sin(x); },
       [](D x) { return std::cos(x); }, [](D x) { return -std::sin(x); }, all},
      {"cos", [](const Jet2& x) { return cos(x); }, [](D x) { return std::cos(x); },
       [](D x) { return -std::sin(x); }, [](D x) { return -std::cos(x); }, all},
      {"1/x", [](const Jet2& x) { return 1.0 / x; }, [](D x) { return 1 / x; },
       [](D x) { return -1 / (x * x); }, [](D x) { return 2 / (x * x * x); }, positive},
  };
  return list;
}

TEST(Jet2, HasTheAnalyticDerivativesOfElementaryFunctions) {
  // Along x(t) with x' = 1.7, x'' = -0.6: f' x', f'' x'^2 + f' x''.
  const double d = 1.7, dd = -0.6;
  for (const Elementary& e : elementary_functions()) {
    for (const double x : e.at) {
      const Jet2 y = e.jet(Jet2(x, d, dd));
      const double first = e.df(x) * d, second = e.ddf(x) * d * d + e.df(x) * dd;
      // Two formulas for one number, a dozen roundings of its terms.
      const double size = 1 + std::abs(e.df(x)) + std::abs(e.ddf(x)) * d * d;
      EXPECT_NEAR(y.value, e.f(x), 8 * eps * (1 + std::abs(e.f(x)))) << e.name << " at " << x;
      EXPECT_NEAR(y.first, first, 32 * eps * size) << e.name << " at " << x;
      EXPECT_NEAR(y.second, second, 32 * eps * size) << e.name << " at " << x;
    }
  }
}

TEST(Jet2, FollowsLeibnizAndUndoesProductsByQuotients) {
  const Jet2 a(1.5, -0.25, 4), b(-2, 3, 0.5);
  // Exact: all products are short binary fractions.
  EXPECT_EQ(a * b, Jet2(-3, -0.25 * -2 + 1.5 * 3, 4 * -2 + 2 * -0.25 * 3 + 1.5 * 0.5));
  EXPECT_EQ(a + b, Jet2(-0.5, 2.75, 4.5));
  EXPECT_EQ(a - b, Jet2(3.5, -3.25, 3.5));
  EXPECT_EQ(a * b / b, a);
  EXPECT_EQ(2.0 * a, a + a);
  EXPECT_EQ(a / 2.0, a * 0.5);
  EXPECT_EQ(1.0 - a, -(a - 1.0));
  EXPECT_EQ(3.0 + a, a + Jet2(3));
}

TEST(Jet2, ObeysIdentitiesBetweenFunctions) {
  for (const double x : {-1.2, 0.1, 0.8}) {
    const Jet2 t(x, 0.9, -1.4);
    const auto expect_equal = [](const Jet2& a, const Jet2& b) {
      EXPECT_NEAR(a.value, b.value, 32 * eps);
      EXPECT_NEAR(a.first, b.first, 64 * eps);
      EXPECT_NEAR(a.second, b.second, 128 * eps);
    };
    expect_equal(sin(t) * sin(t) + cos(t) * cos(t), Jet2(1));
    expect_equal(sin(t + t), 2 * sin(t) * cos(t));
    expect_equal(t * t / t, t);
  }
}

TEST(Jet2, EqualsByAllThree) {
  EXPECT_NE(Jet2(1, 5, 5), Jet2(1, 0, 0));
  EXPECT_EQ(Jet2{}, Jet2(0));
}

TEST(Jet2, IsAnEigenScalar) {
  Eigen::Matrix<Jet2, 2, 2> A;
  A << Jet2(1, 1, 0), Jet2(2), Jet2(0, 3, 0), Jet2(4, 0, 2);
  Eigen::Matrix<Jet2, 2, 1> x(Jet2(1, 0, 1), Jet2(-1, 2, 0));
  const Eigen::Matrix<Jet2, 2, 1> y = A * x;
  EXPECT_EQ(y[0], A(0, 0) * x[0] + A(0, 1) * x[1]);
  EXPECT_EQ(y[1], A(1, 0) * x[0] + A(1, 1) * x[1]);
  const Eigen::Matrix<Jet2, 2, 1> z = Eigen::Matrix2d::Identity() * x * 2.0;
  EXPECT_EQ(z[1], 2.0 * x[1]);
  EXPECT_EQ(x.squaredNorm(), x[0] * x[0] + x[1] * x[1]);
}

TEST(Jet2, PacksAndUnpacksVectors) {
  const Vector a = Vector::LinSpaced(3, 1, 3), b = 2 * a, c = -a;
  const JetVector x = jet(a, b, c);
  EXPECT_EQ(value(x), a);
  EXPECT_EQ(first_derivative(x), b);
  EXPECT_EQ(second_derivative(x), c);
}

static_assert(Jet2(2, 1, 0) * Jet2(3, 0, 1) == Jet2(6, 3, 2), "usable in constant expressions");

}  // namespace
}  // namespace tachless::robot
