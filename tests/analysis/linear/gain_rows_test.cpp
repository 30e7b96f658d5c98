#include "linear/gain_rows.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "numerics/decompositions.h"
#include "tests/analysis/linear/linear_laws.h"
#include "tests/analysis/linear/loops.h"

namespace tachless::linear {
namespace {

using namespace linear::testing;
using controller::law::Discretisation;
using controller::law::FilterGains;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double period_s = 1e-3;
constexpr int delay = 1;
constexpr double all = std::numeric_limits<double>::infinity();

/// The two-link arm of the paper at q = 0 under practical gains.
class GainRows : public ::testing::Test {
 protected:
  const robot::Model model = robot::testing::two_link();
  const messages::ReferencePoint rest = constant_reference(both(0));
  const LinearPlant plant = rigid_plant(model, rest);
  const MatrixXd gradient = gradient_by_q(model, rest);
  const RestLoop loop{plant, law(practical_rigid()), period_s, delay};

  [[nodiscard]] LinearLaw law(const FilterGains& gains, double h = period_s) const {
    return linear_rigid_law(gains, gradient, {Discretisation::tustin, h});
  }
  /// Returns the law without its compensation of gravity.
  [[nodiscard]] LinearLaw feedback(const FilterGains& gains) const {
    LinearLaw made = law(gains);
    made.D -= made.compensation;
    return made;
  }
  [[nodiscard]] SampledLoop sampled() const {
    return {plant, [this](double h) { return law(practical_rigid(), h); }, delay};
  }
  /// Returns the gains with factors exp(d): kp of both joints, then kd.
  static FilterGains moved(const VectorXd& d) {
    FilterGains gains = practical_rigid();
    gains.kp.array() *= d.head(2).array().exp();
    gains.kd.array() *= d.tail(2).array().exp();
    return gains;
  }
  /// Returns the feedback with its derivatives by the logarithms of kp and kd.
  [[nodiscard]] Feedback with_derivatives() const {
    constexpr double step = 1e-4;  // central: errors of 1e-8 of the derivative
    Feedback made{feedback(practical_rigid()), {}, true};
    for (const Index kind : {0, 2}) {
      VectorXd d = VectorXd::Zero(4);
      d.segment(kind, 2).setConstant(step);
      const LinearLaw up = feedback(moved(d)), down = feedback(moved(-d));
      const auto slope = [&](MatrixXd LinearLaw::*part) {
        return MatrixXd((up.*part - down.*part) / (2 * step));
      };
      made.by_kind.push_back({slope(&LinearLaw::A), slope(&LinearLaw::B), slope(&LinearLaw::C),
                              slope(&LinearLaw::D), up.measured});
    }
    return made;
  }
};

TEST_F(GainRows, ClosedHasTheRadiusOfTheSampledLoop) {
  const MatrixXd map = loop.closed(feedback(practical_rigid()));
  EXPECT_NEAR(numerics::eigenvalues(map).cwiseAbs().maxCoeff(), radius_at(sampled(), period_s),
              1e-9);  // rounding of eigenvalues near 1
}

TEST_F(GainRows, ModulusIsThatOfMarginsOnAGrid) {
  const Feedback here{feedback(practical_rigid()), {}, true};
  const auto grid = at_frequencies(here, kept_frequencies(period_s), period_s);
  const double refined = margins(sampled(), period_s).modulus;
  const double least = loop.least_modulus(grid, all);
  const std::vector<double> each = loop.modulus(grid, all);
  EXPECT_EQ(least, *std::ranges::min_element(each));
  // A grid has no smaller value than the refined minimum. Its neighbours differ by 8 % in
  // frequency, and the minimum is flat.
  EXPECT_GE(least, refined * (1 - 1e-6));
  EXPECT_LE(least, refined * 1.02);
  EXPECT_LT(refined, 0.7);  // the loop has a margin below 1, which the grid has to find
}

TEST_F(GainRows, ValuesAboveEnoughAreBoundsFromBelow) {
  const Feedback here{feedback(practical_rigid()), {}, true};
  const auto grid = at_frequencies(here, kept_frequencies(period_s), period_s);
  constexpr double enough = 0.65;
  const std::vector<double> exact = loop.modulus(grid, all), quick = loop.modulus(grid, enough);
  int replaced = 0;
  for (std::size_t k = 0; k < exact.size(); ++k) {
    EXPECT_LE(quick[k], exact[k] * (1 + 1e-9)) << k;
    if (quick[k] < exact[k] * (1 - 1e-6)) {
      EXPECT_GT(quick[k], enough) << k;
      ++replaced;
    }
  }
  EXPECT_GT(replaced, 0);
}

TEST_F(GainRows, ResponsesOfAllFrequenciesAreThoseOfEach) {
  const Feedback here{feedback(practical_rigid()), {}, true};
  const std::vector<double> w = kept_frequencies(period_s);
  const auto together = at_frequencies(here, w, period_s);
  for (std::size_t k = 0; k < w.size(); ++k) {
    const FeedbackAt alone = at_frequency(here, w[k], period_s);
    EXPECT_LT((together[k].K - alone.K).norm(), 1e-9 * alone.K.norm()) << w[k];
  }
}

TEST_F(GainRows, RowsAreTheSlopesOfTheDistance) {
  const Feedback here = with_derivatives();
  constexpr double step = 1e-4;
  for (const double w : {20.0, 150.0, 700.0}) {
    const FeedbackAt at = at_frequency(here, w, period_s);
    constexpr double least = 0.5;
    std::vector<numerics::LinearProgramme::Row> rows;
    loop.add_rows(at, here, least, all, rows);
    ASSERT_EQ(rows.size(), 2U) << w;
    const auto& nearest =
        *std::ranges::max_element(rows, {}, [](const auto& row) { return row.least; });
    const auto distance = [&](const VectorXd& d) {
      const Feedback law{feedback(moved(d)), {}, true};
      return loop.least_modulus({at_frequency(law, w, period_s)}, all);
    };
    EXPECT_NEAR(least - nearest.least, distance(VectorXd::Zero(4)), 1e-9) << w;
    for (Index i = 0; i < 4; ++i) {
      const VectorXd d = step * VectorXd::Unit(4, i);
      // Central differences: the error is of the order of step squared times a third derivative.
      EXPECT_NEAR(nearest.gradient[i], (distance(d) - distance(-d)) / (2 * step), 1e-5)
          << w << " " << i;
    }
  }
}

TEST_F(GainRows, ErrorsAreThePowersOfTheMap) {
  const LinearLaw here = feedback(practical_rigid());
  const MatrixXd map = loop.closed(here);
  const Errors seen = errors(loop, here, 0.01, 0.05, 40);
  ASSERT_EQ(seen.time_s.size(), 41U);
  MatrixXd state = loop.starts(here);
  for (int tick = 1; tick <= 50; ++tick) {
    state = map * state;
    if (tick < 10) continue;
    const auto k = static_cast<std::size_t>(tick - 10);
    EXPECT_NEAR(seen.time_s[k], tick * period_s, 1e-12);
    const MatrixXd now = state.topRows(2);
    const Eigen::Map<const VectorXd> expected(now.data(), 4);
    EXPECT_LT((seen.error.row(static_cast<Index>(k)).transpose() - expected).norm(), 1e-9) << tick;
  }
}

TEST(Errors, AreSettledAfterTheLastInstantAboveOnePerCent) {
  Errors seen{{1, 2, 3}, MatrixXd(3, 4)};
  // Columns 0 and 1: both joints after joint 1 is displaced.
  seen.error << 0.5, 0, 0.009, 0.009,  //
      0.002, -0.02, 0, 0,              //
      0.009, 0.009, 0, 0;
  EXPECT_EQ(seen.last_unsettled_s(), Eigen::Vector2d(2, 0));
}

}  // namespace
}  // namespace tachless::linear
