#include "robot/inverse_dynamics.h"

#include <gtest/gtest.h>

#include <cmath>

#include "robot/energy.h"
#include "robot/mass_matrix.h"
#include "tests/robot/robots.h"

namespace robot {
namespace {

using testing::Random;
using testing::TwoLinkClosedForm;

constexpr double pi = 3.14159265358979323846;
constexpr double eps = 2.220446049250313e-16;
/// Rounding of some tens of operations on terms whose size the test states.
constexpr double rounding = 64 * eps;

class TwoLink : public ::testing::TestWithParam<double> {
 protected:
  const Model model = testing::two_link(GetParam());
  const TwoLinkClosedForm closed{GetParam()};
  Random random{7};
};
INSTANTIATE_TEST_SUITE_P(Payload, TwoLink, ::testing::Values(0.0, 0.5));

TEST_P(TwoLink, HasTheInertiaCoriolisAndGravityOfTheClosedForm) {
  for (int k = 0; k < 1000; ++k) {
    const Vector q = random.vector(2, pi), v = random.vector(2, 5);
    // Sizes of the terms: M to 12, C to h |v| (times 2 in C12), g to g0 (g1 + g2).
    EXPECT_LT((mass_matrix(model, q) - closed.M(q)).cwiseAbs().maxCoeff(), rounding * 12);
    EXPECT_LT((coriolis_matrix(model, q, v) - closed.C(q, v)).cwiseAbs().maxCoeff(),
              rounding * 12 * v.norm());
    EXPECT_LT((gravity_torque(model, q) - closed.g(q)).cwiseAbs().maxCoeff(), rounding * 100);
  }
}

TEST_P(TwoLink, AddsInertiaCoriolisAndGravityUp) {
  for (int k = 0; k < 1000; ++k) {
    const Vector q = random.vector(2, pi), v = random.vector(2, 5), a = random.vector(2, 20);
    const Vector expected = closed.M(q) * a + closed.C(q, v) * v + closed.g(q);
    // Terms to 12 * 20 + 2 * 50 + 100.
    EXPECT_LT((inverse_dynamics(model, q, v, a) - expected).cwiseAbs().maxCoeff(), rounding * 440);
  }
}

}  // namespace
}  // namespace robot
