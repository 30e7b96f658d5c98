#include "controller/law/rivals/difference_of_error.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::difference_of_error_test {
namespace {

DifferenceOfError law_at(double period_s, int samples) {
  return {two_link_model(), {vector(4000, 1000), vector(400, 60), samples}, {period_s}};
}

const Sine reference{{0.5, 0.4}, 2.5};

TEST(DifferenceOfError, ApproachesWenBayardAtFirstOrder) {
  // nu starts at 0, which the sampled loop forgets in 3 periods.
  const State<4> x0 = rigid_state({0.2, -0.2}, reference.at(0).v_ref);
  expect_first_order([](double h) { return law_at(h, 3); }, RigidArm::position,
                     WenBayardLoop{{4000, 1000}, {400, 60}, reference}, x0, reference, 1e-3);
}

TEST(DifferenceOfError, HasNoLagOnTheReference) {
  // The run starts 0.1 rad off the reference, where a difference of positions lags.
  const DifferenceOfError law = law_at(1e-3, 8);
  const auto measured = [&](double t) {
    return messages::PositionMeasurement{reference.at(t).q_ref + vector(0.1, 0.1)};
  };
  auto memory = law.start(measured(0), reference.at(0));
  for (int k = 0; k < 20; ++k) {
    const auto step = law.step(memory, measured(1e-3 * k), reference.at(1e-3 * k));
    memory = step.memory;
    // Differences of 0.6 rad, rounded, over 8 ms.
    EXPECT_LT(step.signals.value[1].norm(), 1e-13) << k;
  }
}

}  // namespace
}  // namespace tachless::controller::law::difference_of_error_test
