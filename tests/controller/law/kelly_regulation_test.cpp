#include "controller/law/kelly_regulation.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/controller/law/two_link.h"

namespace tachless::controller::law {
namespace {

TEST(KellyRegulation, IsGravityLessProportionalAndFilteredError) {
  const TwoLink<double> arm;
  const KellyRegulation::Gains gains{vector(300, 80), vector(40, 9), vector(60, 60),
                                     vector(50, 70)};
  const double h = 1e-3;
  const KellyRegulation law(two_link_model(), gains, {h, Discretisation::backward_euler});
  Random random(1);
  const robot::Vector zero = robot::Vector::Zero(2);
  for (int i = 0; i < 200; ++i) {
    const loop::ReferencePoint goal{random.pair(2), zero, zero, zero, zero};
    const loop::PositionMeasurement measured{random.pair(2)};
    const KellyRegulation::Memory memory{random.pair(2), random.pair(2)};
    const auto step = law.step(memory, measured, goal);
    const Pair e = measured.q - goal.q_ref;
    // nu_k = (nu_{k-1} + b (e_k - e_{k-1})) / (1 + a h)
    Pair nu;
    for (int j = 0; j < 2; ++j) {
      nu[j] = (memory.nu[j] + gains.b[j] * (e[j] - memory.e_previous[j])) / (1 + gains.a[j] * h);
    }
    const Pair tau = arm.g(measured.q) - gains.kp.cwiseProduct(e) - gains.kd.cwiseProduct(nu);
    // 20 eps of terms of up to 2e4 N m
    EXPECT_LE((step.command.tau - tau).norm(), 1e-10);
  }
}

}  // namespace
}  // namespace tachless::controller::law
