#include "controller/law/loria_ortega_matrix.h"

#include <gtest/gtest.h>

#include "controller/law/loria_ortega_rigid.h"
#include "tests/controller/law/two_link.h"

namespace tachless::controller::law::loria_ortega_matrix_test {
namespace {

TEST(LoriaOrtegaMatrix, IsThePapersLawInOtherCoordinatesOfTheErrors) {
  // With diagonal matrices the law is the paper's; other entries multiply the errors by their
  // columns.
  Random random(1);
  const Vector a = vector(300, 300), b = vector(200, 200);
  const Vector kp = vector(4000, 1500), kd = vector(300, 60);
  MatrixGains gains{kp.asDiagonal(), kd.asDiagonal(), 300, 200};
  const LoriaOrtegaRigid diagonal(two_link_model(), {kp, kd, a, b}, {});
  const LoriaOrtegaMatrix same(two_link_model(), gains, {});
  gains.kp(0, 1) = gains.kp(1, 0) = 700;
  gains.kd(0, 1) = gains.kd(1, 0) = -40;
  const LoriaOrtegaMatrix coupled(two_link_model(), gains, {});
  for (int i = 0; i < 100; ++i) {
    const Filter::Memory memory{random.pair(10), random.pair(1)};
    const messages::PositionMeasurement measured{random.pair(3)};
    const messages::ReferencePoint ref = random.reference();
    const auto expected = diagonal.step(memory, measured, ref);
    const auto step = coupled.step(memory, measured, ref);
    // Rounding of torques of up to 1e5 N m.
    EXPECT_LT((same.step(memory, measured, ref).command.tau - expected.command.tau).norm(), 1e-9);
    const Vector &e = step.signals.value[0], &nu = step.signals.value[1];
    EXPECT_EQ(nu, expected.signals.value[1]);
    const Vector more = vector(-700 * e[1] + 40 * nu[1], -700 * e[0] + 40 * nu[0]);
    EXPECT_LT((step.command.tau - expected.command.tau - more).norm(), 1e-9);
  }
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_matrix_test
