// Intervals of least squares from residuals whose noise the tests know.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <random>

#include "identify/least_squares.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A regression of 2000 rows and three parameters, and noise for it.
class Intervals : public ::testing::Test {
 protected:
  static constexpr int rows = 2000, runs = 300;

  MatrixXd drawn(Eigen::Index cols) {
    return MatrixXd::Zero(rows, cols).unaryExpr([this](double /*zero*/) {
      return normal_(random_);
    });
  }
  /// Returns white noise, each row the mean of so many numbers.
  VectorXd noise(int alike) {
    const VectorXd white = drawn(1);
    VectorXd result = white;
    for (int i = 1; i < alike; ++i) result.tail(rows - i) += white.head(rows - i);
    return result / alike;
  }
  /// Returns what least squares leaves of white noise.
  VectorXd residual_of(const MatrixXd& J) {
    const VectorXd all = noise(1);
    return all - J * J.colPivHouseholderQr().solve(all);
  }
  /// Returns the share of the runs in which each interval contains the error.
  Eigen::ArrayXd held(const MatrixXd& J, int alike) {
    const MatrixXd inverse = (J.transpose() * J).inverse();
    Eigen::ArrayXd share = Eigen::ArrayXd::Zero(J.cols());
    for (int run = 0; run < runs; ++run) {
      const VectorXd all = noise(alike);
      const VectorXd error = inverse * (J.transpose() * all);
      const Precision found = precision(J, all - J * error);
      share += (error.array().abs() <= found.half_width.array()).cast<double>() / runs;
    }
    return share;
  }
  /// Returns columns that vary slowly, as those of a motion do.
  static MatrixXd low_in_time(const MatrixXd& columns) { return low_passed(columns, 1e-3, 5); }

 private:
  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
};

/// 95 % of 300 less and plus three standard deviations of 1.3 %.
TEST_F(Intervals, HoldInNineteenOfTwentyRunsWithWhiteNoise) {
  const Eigen::ArrayXd share = held(low_in_time(drawn(3)), 1);
  EXPECT_GE(share.minCoeff(), 0.91) << share;
  EXPECT_LE(share.maxCoeff(), 0.99) << share;
}

TEST_F(Intervals, HoldWithNoiseThatIsAlikeForSomeRows) {
  const Eigen::ArrayXd share = held(low_in_time(drawn(3)), 10);
  EXPECT_GE(share.minCoeff(), 0.91) << share;
  EXPECT_LE(share.maxCoeff(), 0.99) << share;
}

/// One of 20 blocks determines nine tenths of a parameter, as the start of a run determines a
/// delay. The estimate follows that block's noise. The residual in that block therefore does not
/// measure the noise.
TEST_F(Intervals, HoldWhereOneBlockTellsNearlyAll) {
  MatrixXd J = drawn(2);
  J.col(0).head(20) *= 30;
  const Eigen::ArrayXd share = held(J, 1);
  // The first interval has one degree of freedom, so it is wider than needed.
  EXPECT_GE(share.minCoeff(), 0.91) << share;
  EXPECT_LE(share[1], 0.99) << share;
}

/// The columns are independent: each estimate has the deviation 1 / |column|. Student's quantile of
/// some 18 degrees of freedom is 2.1. One interval is wrong by a sixth, the mean of 40 by 3 %.
TEST_F(Intervals, AreThoseOfTheNoise) {
  const MatrixXd J = drawn(3);
  Eigen::Array3d mean = Eigen::Array3d::Zero();
  for (int run = 0; run < 40; ++run) mean += precision(J, residual_of(J)).half_width.array() / 40;
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(mean[i] * J.col(i).norm(), 2.1, 0.1 * 2.1) << i;
  }
}

TEST_F(Intervals, AreThreeTimesAsWideForThreeTimesTheNoise) {
  const MatrixXd J = drawn(3);
  const VectorXd residual = residual_of(J);
  const Precision found = precision(J, residual), louder = precision(J, 3 * residual);
  EXPECT_EQ(found.rank, 3);
  for (Eigen::Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(louder.half_width[i], 3 * found.half_width[i], 1e-9 * found.half_width[i]);
  }
}

TEST_F(Intervals, OfAParameterThatThePriorAloneTellsAreThePriors) {
  MatrixXd J = drawn(3);
  J.col(2).setZero();
  Prior prior;
  prior.rows = MatrixXd::Zero(1, 3);
  prior.rows(0, 2) = 4;
  const VectorXd residual = residual_of(J.leftCols(2));
  const Precision found = precision(J, residual, {}, prior);
  EXPECT_NEAR(found.half_width[2], 1.96 / 4, 0.01 * 1.96 / 4);
  EXPECT_EQ(found.by_prior, (std::vector<bool>{false, false, true}));
  const Precision without = precision(J.leftCols(2), residual);
  for (Eigen::Index i = 0; i < 2; ++i) {
    EXPECT_NEAR(found.half_width[i], without.half_width[i], 1e-9 * without.half_width[i]);
  }
}

TEST_F(Intervals, AreInfiniteWhereNothingTells) {
  MatrixXd J = drawn(3);
  J.col(1) = J.col(0);
  const Precision found = precision(J, residual_of(J));
  EXPECT_EQ(found.rank, 2);
  EXPECT_NEAR(found.free(0, 0), 0.5, 1e-9);
  EXPECT_NEAR(found.free(0, 1), -0.5, 1e-9);
  EXPECT_NEAR(found.free(2, 2), 0, 1e-9);
}

/// A deviation known only by its size moves the estimate by up to `by` to either side.
TEST_F(Intervals, ContainTheDeviationsOfTheRows) {
  const MatrixXd J = drawn(3);
  const VectorXd residual = residual_of(J);
  const Precision alone = precision(J, residual);
  for (const double by : {0.0, 0.01, 10.0}) {
    const Precision found = precision(J, residual, {}, {}, J.col(0) * by);
    const double noise_alone = found.half_width[0] - by;
    EXPECT_LE(noise_alone, alone.half_width[0] * (1 + 1e-9)) << by;
    // Far beyond the noise, the error is to one side: 1.645 deviations in place of 1.96.
    EXPECT_GE(noise_alone, 1.645 / 1.96 * alone.half_width[0] * (1 - 1e-9)) << by;
    EXPECT_NEAR(found.half_width[1], alone.half_width[1], 1e-6 * alone.half_width[1]) << by;
  }
  EXPECT_NEAR(precision(J, residual, {}, {}, J.col(0) * 10.0).half_width[0] - 10,
              1.645 / 1.96 * alone.half_width[0], 1e-3 * alone.half_width[0]);
}

/// A parameter at its bound is not free, so the others have the intervals of a regression without
/// it. Its column moves the ends of the blocks of time, and with them the intervals by some
/// percent.
TEST_F(Intervals, OfTheOthersAreWithoutAParameterAtItsBound) {
  MatrixXd J = drawn(3);
  J.col(1) += 3 * J.col(0);
  const VectorXd residual = residual_of(J.rightCols(2));
  const Precision found = precision(J, residual, {true, false, false});
  const Precision without = precision(J.rightCols(2), residual);
  for (Eigen::Index i = 1; i < 3; ++i) {
    EXPECT_NEAR(found.half_width[i], without.half_width[i - 1], 0.1 * without.half_width[i - 1]);
  }
  EXPECT_GT(found.half_width[0], 2 * found.half_width[1]);
}

}  // namespace
}  // namespace tachless::identify
