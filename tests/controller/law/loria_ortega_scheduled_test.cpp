#include "controller/law/loria_ortega_scheduled.h"

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::loria_ortega_scheduled_test {
namespace {

const ScheduledGains gains{12, 0.8, 150, 200};

TEST(LoriaOrtegaScheduled, IsTheContinuousLawAsThePeriodShrinks) {
  const Sine reference;
  const Pair D(20, 5);
  const auto rate = [&](double t, const State<6>& x) -> State<6> {
    const messages::ReferencePoint r = reference.at(t);
    const TwoLink<double> arm;
    const Pair q = x.head<2>(), v = x.segment<2>(2), nu = x.tail<2>();
    const Pair e = q - Pair(r.q_ref), edot = v - Pair(r.v_ref);
    const Eigen::Matrix2d M = arm.M(r.q_ref), Kd = 2 * gains.damping * gains.w * M,
                          Kp = gains.w * (gains.w * M + Eigen::Matrix2d(D.asDiagonal()));
    State<6> dot;
    dot << RigidArm{}(x.head<4>(), arm.torque(q, r.v_ref, r.v_ref, r.a_ref) - Kp * e - Kd * nu),
        gains.b * edot - gains.a * nu;
    return dot;
  };
  State<6> x0;
  x0 << 0.2, -0.1, 0, 0.3, 0, 0;
  expect_first_order(
      [&](double h) {
        Settings settings{h};
        settings.friction.viscous = D;
        return LoriaOrtegaScheduled(two_link_model(), gains, settings);
      },
      RigidArm::position, rate, x0, reference, 2e-3);
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_scheduled_test
