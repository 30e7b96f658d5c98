#include "controller/law/loria_ortega_integral.h"

#include <numbers>

#include "controller/law/loria_ortega_rigid.h"
#include "tests/controller/law/first_order.h"

namespace tachless::controller::law {
namespace {

const IntegralGains gains{vector(4000, 1500),
                          vector(300, 60),
                          vector(300, 300),
                          vector(200, 250),
                          vector(1500, 500),
                          10,
                          0.15};

TEST(LoriaOrtegaIntegral, IsTheContinuousLawAsThePeriodShrinks) {
  const Sine reference;
  const Pair q0(0.2, -0.1), v0(0, 0.3);
  const auto rate = [&](double t, const State<8>& x) -> State<8> {
    const messages::ReferencePoint r = reference.at(t);
    const Pair q = x.head<2>(), v = x.segment<2>(2), nu = x.segment<2>(4), y = x.tail<2>();
    const Pair e = q - Pair(r.q_ref), edot = v - Pair(r.v_ref);
    const Pair tau = TwoLink<double>().torque(q, r.v_ref, r.v_ref, r.a_ref) -
                     gains.kp.cwiseProduct(e) - gains.kd.cwiseProduct(nu) -
                     gains.ki.cwiseProduct(y);
    State<8> dot;
    dot << RigidArm{}(x.head<4>(), tau), gains.b.cwiseProduct(edot) - gains.a.cwiseProduct(nu),
        edot + gains.eps_1 * e - gains.eps_2 * nu;
    return dot;
  };
  State<8> x0;
  x0 << q0, v0, Pair::Zero(), Pair::Zero();
  for (const Discretisation filter : {Discretisation::first_order_hold, Discretisation::tustin}) {
    expect_first_order(
        [&](double h) {
          return LoriaOrtegaIntegral(two_link_model(), gains, {h, filter});
        },
        RigidArm::position, rate, x0, reference, 2e-3);
  }
}

TEST(LoriaOrtegaIntegral, TakesUpAConstantTorqueThatLeavesAnErrorOtherwise) {
  const Pair d(-60, 20);
  const RigidArm arm;
  const auto pushed = [&](const State<4>& x, const Pair& tau) { return arm(x, tau + d); };
  const Sine rest{{0, 0}};
  const double h = 1e-3;
  const auto end = [&](const auto& law) {
    return Pair(
        sampled_loop(law, State<4>(State<4>::Zero()), pushed, RigidArm::position, rest, h, 8000)
            .back()
            .template head<2>());
  };
  const Pair with = end(LoriaOrtegaIntegral(two_link_model(), gains, {h}));
  const Pair without =
      end(LoriaOrtegaRigid(two_link_model(), {gains.kp, gains.kd, gains.a, gains.b}, {h}));
  const double count = 2 * std::numbers::pi / (1 << 20);
  EXPECT_LT(with.cwiseAbs().maxCoeff(), count);
  // 8 s are tens of time constants kp / kd of the slowest mode.
  EXPECT_LT((without - d.cwiseQuotient(Pair(gains.kp))).norm(), 1e-6);
}

TEST(LoriaOrtegaIntegral, BeginsWithoutTorqueWhereverTheFilterBegins) {
  for (const FilterStart start : {FilterStart::at_error, FilterStart::zero}) {
    const LoriaOrtegaIntegral law(two_link_model(), gains, {1e-3, Discretisation::tustin, start});
    const messages::PositionMeasurement measured{vector(0.5, -0.3)};
    const messages::ReferencePoint goal = Sine{{0, 0}}.at(0);
    const auto step = law.step(law.start(measured, goal), measured, goal);
    // Rounding of 1500 N m/rad times terms of up to b / a |e|.
    EXPECT_LT(step.signals.value[2].norm(), 1e-10);
  }
}

}  // namespace
}  // namespace tachless::controller::law
