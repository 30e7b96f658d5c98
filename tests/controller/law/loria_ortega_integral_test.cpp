#include "controller/law/loria_ortega_integral.h"

#include <atomic>
#include <numbers>

#include "base/parallel.h"
#include "controller/law/loria_ortega_rigid.h"
#include "reference/trajectory/point_to_point.h"
#include "tests/controller/law/first_order.h"
#include "tests/support/sanitizer.h"

namespace tachless::controller::law::loria_ortega_integral_test {
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

/// A motion of 0.25 to 0.8 s between random postures, with random limits, gains and unknown
/// torques.
struct HiddenMotion {
  reference::trajectory::PointToPoint reference;
  Pair limit, torque, start;
  IntegralGains gains;

  explicit HiddenMotion(unsigned seed) {
    Random random(seed);
    reference = {random.pair(3), {}, 0.05, random.between(0.25, 0.8)};
    reference.to_rad = reference.from_rad + random.pair(2);
    limit = vector(random.between(150, 500), random.between(25, 100));
    const bool pushed = random.between(0, 1) < 0.7, beside = random.between(0, 1) < 0.5;
    torque = (pushed ? 1.0 : 0.0) * limit.cwiseProduct(Pair(random.pair(0.25)));
    start = reference.from_rad + (beside ? 1.0 : 0.0) * random.pair(0.3);
    const double scale = std::exp(random.between(-0.7, 0.7));
    gains = {scale * scale * vector(4000, 400),
             scale * vector(300, 30),
             vector(300, 300),
             vector(300, 300),
             scale * scale * random.between(0.3, 2) * vector(2000, 200),
             10 * scale,
             0.15 * scale,
             0.4 * Vector(limit)};
  }

  /// Returns whether the loop at 1 kHz with one tick of delay is at rest on the goal at its end.
  [[nodiscard]] bool ends_at_rest(const LoriaOrtegaIntegral& law, int ticks) const {
    const RigidArm arm;
    State<4> x = rigid_state(start, Pair::Zero());
    auto memory = law.start(arm.position(x), reference.at(0));
    Pair applied = Pair::Zero();
    for (int k = 0; k < ticks; ++k) {
      const auto step = law.step(memory, arm.position(x), reference.at(k * 1e-3));
      memory = step.memory;
      const auto pushed = [&](double /*t*/, const State<4>& y) -> State<4> {
        return arm(y, applied + torque);
      };
      for (int i = 0; i < 2; ++i) x = runge_kutta_4(pushed, 0, x, 0.5e-3);
      if (!x.allFinite() || x.norm() > 1e3) return false;
      applied = Pair(step.command.tau).cwiseMax(-limit).cwiseMin(limit);
    }
    return (x.head<2>() - Pair(reference.to_rad)).norm() < 1e-3;
  }
};

/// The law of 0.3.0 had neither rule: about a quarter of these motions never came to rest.
TEST(LoriaOrtegaIntegral, ComesBackFromMotionsBeyondTheTorqueLimits) {
#ifdef __SANITIZE_ADDRESS__
  constexpr unsigned motions = 50;
#else
  constexpr unsigned motions = 1000;
#endif
  std::atomic<int> stayed_away = 0, stayed_away_without = 0;
  base::parallel_for(motions, [&](std::size_t i) {
    const HiddenMotion motion(static_cast<unsigned>(i));
    Settings settings{1e-3, Discretisation::tustin, FilterStart::at_error, 1.5e-3};
    const auto law = [&](const IntegralGains& gains) {
      return LoriaOrtegaIntegral(two_link_model(), gains, settings);
    };
    IntegralGains unlimited = motion.gains;
    unlimited.d_max = vector(infinity, infinity);
    if (i < 50 && !motion.ends_at_rest(law(unlimited), 6000)) ++stayed_away_without;
    settings.torque_limit = motion.limit;
    const bool soon = motion.ends_at_rest(law(motion.gains), 6000);
    if (!soon && !motion.ends_at_rest(law(motion.gains), 30000)) ++stayed_away;
  });
  EXPECT_EQ(stayed_away, 0);
  EXPECT_GT(stayed_away_without, 5) << "of the first 50, without the rules";
}

TEST(LoriaOrtegaIntegral, NeverAsksForMoreThanTheLargestUnknownTorque) {
  Random random(3);
  const Vector limit = vector(320, 60);
  Settings settings{1e-3, Discretisation::tustin};
  settings.torque_limit = limit;
  IntegralGains limited = gains;
  for (const bool given : {false, true}) {
    if (given) limited.d_max = vector(30, 5);
    const LoriaOrtegaIntegral law(two_link_model(), limited, settings);
    const Vector most = given ? limited.d_max : limit;
    EXPECT_EQ(law.integral()->d_max, most);
    messages::PositionMeasurement measured{random.pair(3)};
    auto memory = law.start(measured, random.reference());
    for (int k = 0; k < 1000; ++k) {
      measured.q = random.pair(k % 3 == 0 ? 300 : 1);
      const auto step = law.step(memory, measured, random.reference());
      memory = step.memory;
      // The torque is Ki (d_max / Ki), up to rounding.
      ASSERT_TRUE((step.signals.value[2].array().abs() <= most.array() * (1 + 1e-15)).all());
    }
  }
}

TEST(LoriaOrtegaIntegral, HoldsItsIntegralWhereItWouldCommandBeyondALimit) {
  const Vector limit = vector(100, 50);
  Settings settings{1e-3, Discretisation::tustin};
  settings.torque_limit = limit;
  const LoriaOrtegaIntegral law(two_link_model(), gains, settings);
  const messages::ReferencePoint goal = Sine{{0, 0}}.at(0);
  const messages::PositionMeasurement away{vector(-0.5, 0)};
  auto memory = law.start(away, goal);
  memory = law.step(memory, away, goal).memory;
  for (int k = 0; k < 100; ++k) {
    const auto step = law.step(memory, away, goal);
    ASSERT_GT(step.command.tau[0], limit[0]);
    ASSERT_GE(step.memory.y[0], memory.y[0]) << "the integral of joint 1 adds to what saturates";
    ASSERT_LE(std::abs(step.command.tau[1]), limit[1]);
    memory = step.memory;
  }
}

TEST(LoriaOrtegaIntegral, TakesGainsThatFollowTheReferenceAndRefusesNone) {
  IntegralGains following = gains;
  following.kp = following.kd = {};
  EXPECT_THROW(LoriaOrtegaIntegral(two_link_model(), following, {1e-3}), std::invalid_argument);
  following.w = 20;
  EXPECT_THROW(LoriaOrtegaIntegral(two_link_model(), following, {1e-3}), std::invalid_argument);
  following.damping = 0.8;
  const LoriaOrtegaIntegral law(two_link_model(), following, {1e-3});
  Random random(4);
  for (int k = 0; k < 100; ++k) {
    const messages::ReferencePoint r = random.reference();
    const Pair e = random.pair(1), nu = random.pair(1), tau = random.pair(100);
    const Pair expected = tau - TwoLink<double>().M(Pair(r.q_ref)) * (400 * e + 32 * nu);
    const Pair found = law.feedback(tau, e, nu, r);
    ASSERT_LT((found - expected).norm(), 1e-12 * (1 + expected.norm()));
  }
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_integral_test
