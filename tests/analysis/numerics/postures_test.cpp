#include "numerics/postures.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>

#include "robot/dynamics.h"
#include "tests/core/robot/robots.h"

namespace tachless::numerics {
namespace {

/// Returns two joints, and a third that turns with the second times `multiplier`.
robot::Model with_mimic(const std::string& multiplier) {
  std::string text = robot::testing::chain_urdf(2, 1);
  const std::string old = "joint='j1' multiplier='0.5'";
  text.replace(text.find(old), old.size(), "joint='j2' multiplier='" + multiplier + "'");
  return robot::model_from_urdf(text, "chain");
}

// The harmonics leave out the constant, so differences to q2 = 0 are compared.
TEST(PosturesOfTwoJoints, HaveHarmonicsThatAddUpToMAndC) {
  for (const robot::Model& model :
       {robot::testing::two_link(), with_mimic("0.5"), with_mimic("-1.25"), with_mimic("2")}) {
    const Postures postures(model);
    ASSERT_TRUE(postures.proved);
    const Inertia at_zero = inertia_at(model, Eigen::Vector2d(0, 0));
    for (const double q2 : {0.4, 2.9, -11.3}) {
      Inertia sum = at_zero;
      for (const auto& [order, cosine, sine] : postures.harmonics) {
        const double c = std::cos(order * q2) - 1, s = std::sin(order * q2);
        sum.M += c * cosine.M + s * sine.M;
        for (std::size_t j = 0; j < 2; ++j) sum.C[j] += c * cosine.C[j] + s * sine.C[j];
      }
      const Inertia expected = inertia_at(model, Eigen::Vector2d(0.7, q2));
      // Rounding of some 500 samples, and harmonics below 1e-13 of M that are left out.
      const double rounding = 1e-11 * at_zero.M.norm();
      EXPECT_LT((sum.M - expected.M).norm(), rounding) << q2;
      for (std::size_t j = 0; j < 2; ++j) {
        EXPECT_LT((sum.C[j] - expected.C[j]).norm(), rounding) << q2 << " column " << j;
      }
    }
  }
}

TEST(PosturesOfTwoJoints, AreNotProvedWhereTheSumsDoNotReach) {
  const Postures fast(with_mimic("20"));  // cos(21 q2) in M exceeds the 16 orders that are accepted
  EXPECT_EQ(fast.kind, Postures::Kind::circle);
  EXPECT_FALSE(fast.proved);
  EXPECT_TRUE(fast.harmonics.empty());
  EXPECT_EQ(fast.chord_factor, 0);

  const Postures uneven(with_mimic("0.3141592"));  // no multiple of 1/d for any d <= 8
  EXPECT_EQ(uneven.kind, Postures::Kind::sampled);
  EXPECT_FALSE(uneven.proved);
}

TEST(SampledPostures, SmallestDoesNotNeedValuesThatAreAboveEnough) {
  PostureOptions options;
  options.samples = 500;
  const Postures postures(with_mimic("0.3141592"), options);
  ASSERT_EQ(postures.kind, Postures::Kind::sampled);
  const auto f = [](const Inertia& at) { return at.M(0, 0) + at.C[1].sum(); };
  std::atomic<int> left_out = 0;
  for (const bool refine : {false, true}) {
    const Extreme all = postures.smallest([&](double /*enough*/) { return f; }, {refine});
    const auto only_small = [&](double enough) {
      return [&, enough](const Inertia& at) {
        if (f(at) <= enough) return f(at);
        ++left_out;
        return std::numeric_limits<double>::infinity();
      };
    };
    const Extreme some = postures.smallest(only_small, {refine});
    EXPECT_EQ(some.value, all.value);
    EXPECT_EQ(some.q, all.q);
  }
  EXPECT_GT(left_out, 500);  // of two times 500
}

TEST(MinimiseWithin, FindsTheMinimumInTheBox) {
  const Eigen::Vector3d least(0.3, -0.7, 2);
  const auto f = [&](const Eigen::VectorXd& x) { return (x - least).squaredNorm(); };
  const Eigen::Vector3d none = Eigen::Vector3d::Constant(infinity);
  const Minimum free = minimise_within(f, Eigen::Vector3d::Zero(), {-none, none}, 0.2, 300);
  EXPECT_LT((free.x - least).norm(), 1e-4);  // the search ends at changes of 1e-5
  const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5), at_edge(0.3, -0.5, 0.5);
  const Minimum bounded = minimise_within(f, Eigen::Vector3d::Zero(), {-half, half}, 0.2, 300);
  EXPECT_LT((bounded.x - at_edge).norm(), 1e-4);
  // A box that is narrower than the first step, and one coordinate.
  const Eigen::VectorXd one = Eigen::VectorXd::Ones(1), start = Eigen::VectorXd::Zero(1);
  const auto of_one = [](const Eigen::VectorXd& x) { return std::pow(x[0] - 0.02, 2); };
  EXPECT_NEAR(minimise_within(of_one, start, {-0.05 * one, 0.05 * one}, 0.2, 300).x[0], 0.02, 1e-4);
}

TEST(MinimiseWithin, EndsWhereNoValueIsLess) {
  int calls = 0;
  const auto f = [&](const Eigen::VectorXd& x) { return ++calls < 4 ? x.norm() : -infinity; };
  const Eigen::Vector2d one(1, 1);
  EXPECT_EQ(minimise_within(f, one, {-one, one}, 0.2, 300).value, -infinity);
  EXPECT_EQ(calls, 4);
}

TEST(SampledPostures, RefinementStaysBesideTheCentresAndGoesFromOneToTheNext) {
  // One posture, in the box of the first centre.
  const Postures postures(with_mimic("0.3141592"),
                          {.samples = 1,
                           .centres = {Eigen::Vector2d(0, 1), Eigen::Vector2d(0, 1.15)},
                           .reach = Eigen::Vector2d(0.1, 0.1)});
  ASSERT_EQ(postures.kind, Postures::Kind::sampled);
  ASSERT_LT(postures.q[0][1], 1.1);
  // The stretched arm has the largest M: it falls up to the end of the last centre's box.
  const Extreme least = postures.smallest(
      [](double /*enough*/) { return [](const Inertia& at) { return at.M(0, 0); }; },
      {.refine = true});
  EXPECT_NEAR(least.q[1], 1.25, 1e-4);
}

}  // namespace
}  // namespace tachless::numerics
