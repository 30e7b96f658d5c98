#include "linear/law_answers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <string>

#include "numerics/decompositions.h"

namespace tachless::linear {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

constexpr double h = 1e-3;

/// Two joints: kp e + kd nu with a filter of its own each, and an integral of which a tick adds
/// 1e-9 of the filter's gain.
LinearLaw filtered() {
  const VectorXd kp{{400, 50}}, kd{{1e5, 3e3}}, ki{{0.1, 0.02}};
  const VectorXd pole{{std::exp(-100 * h), std::exp(-7 * h)}};
  LinearLaw law{MatrixXd::Zero(4, 4), MatrixXd::Zero(4, 2), MatrixXd::Zero(2, 4), {}, {}, {}};
  law.A.diagonal() << pole, 1, 1;
  law.B << MatrixXd((1 - pole.array()).matrix().asDiagonal()), MatrixXd::Identity(2, 2);
  law.C << MatrixXd(kd.asDiagonal()), MatrixXd((-1e-3 * ki).asDiagonal());
  law.D = (-kp - kd).asDiagonal();
  return law;
}

/// Step by step, beside a torque at rest; `torque` is of the linear law's, tick and deviation.
template <class F>
Ask asked(const LinearLaw& law, const F& torque) {
  return [law, torque](const MatrixXd& deviations) {
    VectorXd x = VectorXd::Zero(law.A.rows());
    MatrixXd all(law.D.rows(), deviations.cols());
    for (Index k = 0; k < deviations.cols(); ++k) {
      const VectorXd y = deviations.col(k);
      all.col(k) = VectorXd{{80, -20}} + torque(VectorXd(law.C * x + law.D * y), k, y);
      x = law.A * x + law.B * y;
    }
    return all;
  };
}
Ask asked(const LinearLaw& law) {
  return asked(law, [](const VectorXd& tau, Index, const VectorXd&) { return tau; });
}

LinearLaw found(const Ask& ask, Index inputs = 2) {
  return realised(ask, inputs, window_of(ask, inputs), foretold);
}

TEST(LawAnswers, AreThoseOfTheLawsModel) {
  const LinearLaw law = filtered(), model = found(asked(law));
  ASSERT_EQ(model.A.rows(), 4);
  // A torque of 100 N m is rounded by 1e-14 N m, of a deviation of 1e-6 rad: 1e-8 N m/rad.
  EXPECT_LT((model.D - law.D).cwiseAbs().maxCoeff(), 1e-6);
  for (const double w : {0.1, 3.0, 100.0, 3000.0}) {
    const auto response = [&](const LinearLaw& of) {
      const std::complex<double> z = std::polar(1.0, w * h);
      const Eigen::MatrixXcd resolvent =
          z * MatrixXd::Identity(4, 4) - of.A.cast<std::complex<double>>();
      Eigen::MatrixXcd state(4, 2);
      MatrixXd real(8, 8), rhs(8, 2);
      real << resolvent.real(), -resolvent.imag(), resolvent.imag(), resolvent.real();
      rhs << of.B, MatrixXd::Zero(4, 2);
      const MatrixXd x = numerics::solution(real, rhs).value();
      state.real() = x.topRows(4);
      state.imag() = x.bottomRows(4);
      return Eigen::MatrixXcd(of.C * state + of.D);
    };
    const Eigen::MatrixXcd is = response(model), expected = response(law);
    // The second integral is 1e-10 of the filter's gain. A part in 1e4 of it is above rounding.
    for (Index j = 0; j < 2; ++j) {
      EXPECT_LT(std::abs(is(j, j) - expected(j, j)), 1e-3 * std::abs(expected(j, j))) << w;
    }
  }
}

TEST(LawAnswers, NeedNoMemory) {
  LinearLaw law = filtered();
  law.A.resize(0, 0);
  law.B.resize(0, 2);
  law.C.resize(2, 0);
  const LinearLaw model = found(asked(law));
  EXPECT_EQ(model.A.rows(), 0);
  EXPECT_LT((model.D - law.D).cwiseAbs().maxCoeff(), 1e-6);
}

/// Gravity curves the torque in this way, beside small gains.
TEST(LawAnswers, MayBeCurved) {
  LinearLaw law = filtered();
  for (MatrixXd* rows : {&law.C, &law.D}) rows->row(1) *= 1e-2;
  const LinearLaw model =
      found(asked(law, [](const VectorXd& tau, Index, const VectorXd& e) -> VectorXd {
        return tau + VectorXd{{60, 10}} * e.squaredNorm();
      }));
  EXPECT_EQ(model.A.rows(), 4);
  EXPECT_LT(std::abs((model.D - law.D)(1, 1)), 1e-6);
}

/// The mean of the last so many measurements.
Ask mean_of(Index ticks) {
  return [ticks](const MatrixXd& deviations) {
    MatrixXd all = 0 * deviations;
    for (Index k = 0; k < deviations.cols(); ++k) {
      for (Index i = 0; i < std::min(ticks, k + 1); ++i) all.col(k) -= deviations.col(k - i);
    }
    return MatrixXd(100.0 / static_cast<double>(ticks) * all);
  };
}

TEST(LawAnswers, OfALongMemoryNeedALongWindow) {
  EXPECT_EQ(window_of(mean_of(5), 1), 24);
  EXPECT_EQ(window_of(mean_of(40), 1), 96);
  const LinearLaw model = found(mean_of(40), 1);
  const auto at_rest =
      numerics::solution(MatrixXd::Identity(model.A.rows(), model.A.rows()) - model.A, model.B);
  ASSERT_TRUE(at_rest);
  EXPECT_NEAR((model.C * *at_rest + model.D)(0, 0), -100, 1e-4);
}

std::string refusal(const Ask& ask, Index inputs = 2) {
  try {
    window_of(ask, inputs);
  } catch (const NoLinearModel& why) {
    return why.what();
  }
  return "";
}

TEST(LawAnswers, AreRefusedWhereNoLinearLawAnswersSo) {
  const LinearLaw law = filtered();
  EXPECT_THAT(refusal(mean_of(600), 1), HasSubstr("a model of 288 ticks of its answers does not"));
  EXPECT_THAT(
      refusal(asked(law,
                    [n = std::make_shared<int>(0)](const VectorXd& tau, Index, const VectorXd&) {
                      return VectorXd(tau.array() + 1e-6 * (++*n % 5));
                    })),
      HasSubstr("two identical experiments differ by "));
  EXPECT_THAT(refusal(asked(law,
                            [](const VectorXd& tau, Index, const VectorXd&) {
                              return VectorXd(tau.cwiseMin(0.3).cwiseMax(-0.3));
                            })),
              HasSubstr("the answer to deviations of 1e-05 is not 10 times the answer to 1e-06"));
  EXPECT_THAT(
      refusal(asked(law, [](const VectorXd& tau, Index,
                            const VectorXd& e) { return VectorXd(tau + 400 * e.cwiseAbs()); })),
      HasSubstr("the answer to -1e-05 is not the opposite of the answer to 1e-05"));
  EXPECT_THAT(refusal(asked(law,
                            [](const VectorXd& tau, Index, const VectorXd& e) {
                              const double both = std::abs(e[0] + e[1]) > std::abs(e[0] - e[1]);
                              return VectorXd(tau + 400 * both * e);
                            })),
              HasSubstr("the answer to all inputs is not the sum of the answers to each"));
  EXPECT_THAT(refusal(asked(law,
                            [](const VectorXd& tau, Index k, const VectorXd&) {
                              return VectorXd(tau * (1 + 1e-3 * static_cast<double>(k)));
                            })),
              HasSubstr("or it depends on the time"));
}

}  // namespace
}  // namespace tachless::linear
