#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ostream>
#include <string>

#include "tests/analysis/in_process/golden.h"

/// The sampled loop approaches the paper's continuous loop as h goes to 0. The order is one because
/// the torque is held over the tick.
namespace tachless::in_process::convergence_test {
namespace {

using testing::Golden;

struct Case {
  const char* name;
  double coarsest_period_s;
  double duration_s;
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class ContinuousTable : public ::testing::TestWithParam<Case> {};

TEST_P(ContinuousTable, IsApproachedWithFirstOrder) {
  const Golden golden(GetParam().name);
  double error[3] = {};
  for (int i = 0; i < 3; ++i) {
    const double h = GetParam().coarsest_period_s / (1 << i);
    testing::walk_rows(golden, testing::golden_scenario(GetParam().name, h, GetParam().duration_s),
                       GetParam().duration_s, [&](std::size_t row, const TickRecord& record) {
                         const Vector difference = record.truth.q - golden.value(row, "q");
                         error[i] = std::max(error[i], difference.cwiseAbs().maxCoeff());
                       });
  }
  const double first = std::log2(error[0] / error[1]);
  const double second = std::log2(error[1] / error[2]);
  RecordProperty("error_rad", std::to_string(error[0] * 1e9) + " " +
                                  std::to_string(error[1] * 1e9) + " " +
                                  std::to_string(error[2] * 1e9) + " e-9");
  RecordProperty("order", std::to_string(first) + " " + std::to_string(second));
  // The order is 1 plus the contribution of the second-order term, which must shrink with h.
  EXPECT_NEAR(second, 1, 0.15);
  EXPECT_LT(std::abs(second - 1), std::abs(first - 1) + 0.02);
}

INSTANTIATE_TEST_SUITE_P(, ContinuousTable,
                         ::testing::Values(Case{"rigid_continuous_paper_rest", 2.5e-5, 0.2},
                                           Case{"rigid_continuous_paper_offset", 2.5e-5, 0.2},
                                           Case{"flexible_continuous_paper_rest", 5e-6, 0.04},
                                           Case{"flexible_continuous_practical_rest", 2.5e-4, 1}));

/// Returns the largest |e| of each joint from `from_s` on.
Vector steady_error(const scenario::Scenario& scenario, double from_s) {
  Vector peak = Vector::Zero(2);
  run_in_process(scenario, [&](const TickRecord& record) {
    if (record.time_s >= from_s) peak = peak.cwiseMax(record.controller.value[0].cwiseAbs());
    return true;
  });
  return peak;
}

// An independent simulation gave these figures with three digits. Its own fit is accurate to some
// per cent.
TEST(SteadyError, OfThePapersRigidGainsIsProportionalToThePeriod) {
  const Vector expected = Eigen::Vector2d(2.48e-2, 3.37e-3);
  for (const double h : {5e-5, 2.5e-5}) {
    const Vector error =
        steady_error(testing::golden_scenario("rigid_paper_foh_d0_on_reference", h, 0.6), 0.2);
    EXPECT_LT((error / h - expected).cwiseQuotient(expected).norm(), 0.05) << error.transpose() / h;
  }
}

TEST(SteadyError, IsThreeTimesAsLargeWithOneTickOfDelay) {
  const double h = 2e-5;
  const auto error = [&](const char* name) {
    return steady_error(testing::golden_scenario(name, h, 0.6), 0.2);
  };
  const Vector ratio = error("rigid_paper_foh_d1_on_reference")
                           .cwiseQuotient(error("rigid_paper_foh_d0_on_reference"));
  // The ratio is 3 to first order in h.
  EXPECT_NEAR(ratio[0], 3, 0.1);
  EXPECT_NEAR(ratio[1], 3, 0.1);
}

TEST(SlowPole, OfThePapersRigidGainsIsThatOfTheTable) {
  // At whole periods of the reference the error is the transient alone. It shrinks by exp(-0.7145
  // 0.2) and exp(-0.6814 0.2).
  Vector error[2];
  run_in_process(testing::golden_scenario("rigid_paper_foh_d0_rest", 5e-5, 0.6),
                 [&](const TickRecord& record) {
                   if (record.tick == 8000) error[0] = record.controller.value[0];
                   if (record.tick == 12000) error[1] = record.controller.value[0];
                   return true;
                 });
  const Vector pole = (error[0].array() / error[1].array()).log() / 0.2;
  EXPECT_NEAR(pole[0], 0.7145, 0.01);
  EXPECT_NEAR(pole[1], 0.6814, 0.01);
}

}  // namespace
}  // namespace tachless::in_process::convergence_test
