#include "controller/law/loria_ortega_bounded.h"

#include <cmath>
#include <vector>

#include "base/parallel.h"
#include "controller/law/loria_ortega_integral.h"
#include "controller/law/loria_ortega_rigid.h"
#include "reference/trajectory/point_to_point.h"
#include "tests/controller/law/first_order.h"
#include "tests/core/robot/robots.h"
#include "tests/support/sanitizer.h"

namespace tachless::controller::law::loria_ortega_bounded_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

const Vector limit = vector(320, 60);

Settings limited(double feedforward_lead_s = 0, const Vector& torque_limit = limit) {
  Settings settings{1e-3, Discretisation::tustin, FilterStart::at_error, feedforward_lead_s};
  settings.torque_limit = torque_limit;
  return settings;
}

BoundedGains gains_with(const Vector& feedforward_max) {
  return {vector(4000, 400), vector(300, 30), vector(300, 300), vector(300, 300), feedforward_max};
}

BoundedGains with_integral(const Vector& feedforward_max, const Vector& d_max) {
  BoundedGains gains = gains_with(feedforward_max);
  gains.ki = vector(2000, 200);
  gains.eps_1 = 10;
  gains.eps_2 = 0.15;
  gains.d_max = d_max;
  return gains;
}

/// Random and hostile inputs and memories: no command exceeds a limit by more than rounding.
void expect_within_limits(const BoundedGains& gains) {
#ifdef __SANITIZE_ADDRESS__
  constexpr int inputs = 20000;
#else
  constexpr int inputs = 1000000;
#endif
  Random random(1);
  const LoriaOrtegaBounded law(two_link_model(), gains, limited());
  // Sizes from a thousandth to 1e60: the squares of velocities stay finite.
  const auto any = [&]() -> Vector {
    return std::pow(10.0, random.between(-3, random.between(0, 60))) * random.pair(1);
  };
  const auto usual = [&]() -> Vector { return random.pair(3); };
  double most = 0;
  for (int i = 0; i < inputs; ++i) {
    const bool hostile = i % 2 == 0;
    const auto draw = [&] { return hostile ? any() : usual(); };
    const messages::ReferencePoint reference{draw(), draw(), draw(), draw(), draw()};
    const LoriaOrtegaBounded::Memory memory{{draw(), draw()}, draw()};
    const auto step = law.step(memory, {draw()}, reference);
    ASSERT_TRUE(step.command.tau.allFinite());
    most = std::max(most, (step.command.tau.cwiseAbs().cwiseQuotient(limit)).maxCoeff());
  }
  EXPECT_LE(most, 1 + 1e-15);  // rounding of F + L + d_max
  EXPECT_GT(most, 0.999);
}

TEST(LoriaOrtegaBounded, CommandsNoMoreThanTheLimitsWhateverItReceives) {
  expect_within_limits(gains_with({}));
}
TEST(LoriaOrtegaBounded, WithAnIntegralCommandsNoMoreThanTheLimitsWhateverItReceives) {
  expect_within_limits(with_integral(vector(150, 30), vector(60, 12)));
}

TEST(LoriaOrtegaBounded, IsTheRigidLawWhereNothingIsBounded) {
  Random random(2);
  const BoundedGains gains = gains_with(vector(200, 30));
  const LoriaOrtegaBounded law(two_link_model(), gains, limited(1.5e-3));
  const LoriaOrtegaRigid rigid(two_link_model(), {gains.kp, gains.kd, gains.a, gains.b},
                               limited(1.5e-3));
  for (int i = 0; i < 1000; ++i) {
    messages::ReferencePoint reference{random.pair(3), random.pair(0.5), random.pair(2),
                                       random.pair(5), random.pair(5)};
    const messages::PositionMeasurement measured{reference.q_ref + random.pair(0.01)};
    const Filter::Memory memory{random.pair(0.05), measured.q - reference.q_ref};
    const Vector tau = rigid.step(memory, measured, reference).command.tau;
    const auto step = law.step({memory, random.pair(1)}, measured, reference);
    ASSERT_LE((step.command.tau - tau).norm(), 1e-12 * tau.norm());
    ASSERT_EQ(step.memory.y, vector(0, 0)) << "there is no integral";
  }
}

TEST(LoriaOrtegaBounded, IsTheIntegralLawWhereNothingIsBounded) {
  Random random(5);
  const BoundedGains gains = with_integral(vector(200, 30), vector(60, 12));
  const LoriaOrtegaBounded law(two_link_model(), gains, limited(1.5e-3));
  const LoriaOrtegaIntegral integral(
      two_link_model(),
      {gains.kp, gains.kd, gains.a, gains.b, gains.ki, gains.eps_1, gains.eps_2, gains.d_max},
      limited(1.5e-3));
  messages::ReferencePoint reference = Sine{{0, 0}}.at(0);
  messages::PositionMeasurement measured{random.pair(0.005)};
  auto memory = law.start(measured, reference);
  auto same = integral.start(measured, reference);
  for (int i = 0; i < 1000; ++i) {
    // Slow errors: the filter's output is small beside kp e.
    measured.q = 0.999 * measured.q + random.pair(5e-6);
    const auto step = law.step(memory, measured, reference);
    const auto expected = integral.step(same, measured, reference);
    const Vector tau = expected.command.tau;
    ASSERT_LE((step.command.tau - tau).norm(), 1e-12 * (1 + tau.norm()));
    memory = step.memory;
    same = expected.memory;
  }
  EXPECT_GT(memory.y.norm(), 1e-3);
}

TEST(LoriaOrtegaBounded, RefusesDrivesWithoutLimitsAndAFeedForwardThatLeavesNothing) {
  const auto made = [](const BoundedGains& gains, const Settings& settings = limited()) {
    return LoriaOrtegaBounded(two_link_model(), gains, settings);
  };
  EXPECT_THROW(made(gains_with({}), Settings{1e-3}), std::invalid_argument);
  EXPECT_THROW(made(gains_with(limit)), std::invalid_argument);
  EXPECT_EQ(made(gains_with({})).feedforward_max(), Vector(0.7 * limit));
  const Vector d_max = vector(60, 12);
  EXPECT_EQ(made(with_integral({}, d_max)).feedforward_max(), Vector(0.7 * limit - d_max));
  EXPECT_THROW(made(with_integral({}, limit)), std::invalid_argument);
  EXPECT_THROW(made(with_integral(vector(280, 50), d_max)), std::invalid_argument);
  EXPECT_THROW(made(with_integral({}, {})), std::invalid_argument) << "without d_max";
  BoundedGains in_part = with_integral({}, d_max);
  in_part.eps_2 = 0;
  EXPECT_THROW(made(in_part), std::invalid_argument);
}

/// The proof's energy: 1/2 edot' M edot and integrals of S. With w of the filter, alpha = kp + kd b
/// and beta = kd b, it falls by friction less Cd, and by a sum that no state makes negative.
void expect_energy_identity(const robot::Model& model, unsigned seed) {
  robot::testing::Random random(seed);
  const Eigen::Index n = model.num_joints;
  for (int i = 0; i < 1000; ++i) {
    const auto positive = [&](double most) -> VectorXd {
      return VectorXd(random.vector(n, most).cwiseAbs().array() + 0.01 * most);
    };
    const VectorXd kp = positive(5000), kd = positive(300), a = positive(300), b = positive(300),
                   D = positive(20);
    Settings settings{1e-3};
    settings.torque_limit = Vector(positive(500));
    const LoriaOrtegaBounded law(model, {kp, kd, a, b, Vector(0.5 * settings.torque_limit)},
                                 settings);
    const auto S = [&](const VectorXd& u) -> VectorXd { return law.bounded(u); };
    const Vector q = random.vector(n, 3), v_ref = random.vector(n, 2), zero = Vector::Zero(n);
    const VectorXd e = random.vector(n, 1), edot = random.vector(n, 3), w = random.vector(n, 1);
    const Vector v = v_ref + Vector(edot);
    const auto jets = robot::mass_matrix(model, robot::jet(q, v, zero));
    MatrixXd M(n, n), Mdot(n, n);
    for (Eigen::Index j = 0; j < n; ++j) {
      for (Eigen::Index k = 0; k < n; ++k) {
        M(j, k) = jets(j, k).value;
        Mdot(j, k) = jets(j, k).first;
      }
    }
    const MatrixXd Cd = robot::coriolis_matrix(model, q, v_ref);
    const MatrixXd C = robot::coriolis_matrix(model, q, v) + Cd;
    const VectorXd beta = kd.cwiseProduct(b), alpha = kp + beta;
    const VectorXd wdot = a.cwiseProduct(e - w), nu = b.cwiseProduct(e - w);
    const VectorXd u = alpha.cwiseProduct(e) - beta.cwiseProduct(w);
    ASSERT_LE((u - kp.cwiseProduct(e) - kd.cwiseProduct(nu)).norm(), 1e-12 * u.norm());
    const VectorXd M_eddot = -(C + MatrixXd(D.asDiagonal())) * edot - S(u);
    const VectorXd by_w = beta.cwiseQuotient(alpha);
    const double rate[] = {edot.dot(M_eddot), edot.dot(Mdot * edot) / 2,
                           S(u).dot(edot - by_w.cwiseProduct(wdot)),
                           S(kp.cwiseProduct(w)).dot(by_w.cwiseProduct(wdot))};
    const VectorXd difference = S(u) - S(kp.cwiseProduct(w));
    const double filtered = by_w.cwiseProduct(wdot).dot(difference);
    ASSERT_GE(filtered, 0) << "S increases, and u - kp w = alpha (e - w)";
    const double claimed[] = {edot.dot((MatrixXd(D.asDiagonal()) + Cd) * edot), filtered};
    double sum = 0, size = 0;
    for (const double term : rate) sum += term, size += std::abs(term);
    for (const double term : claimed) sum += term, size += std::abs(term);
    ASSERT_NEAR(sum, 0, 1e-12 * size);
  }
}

TEST(LoriaOrtegaBounded, EnergyFallsAsProvedForTwoJoints) {
  expect_energy_identity(robot::testing::two_link(), 3);
}
TEST(LoriaOrtegaBounded, EnergyFallsAsProvedForSevenJoints) {
  expect_energy_identity(robot::testing::iiwa7(), 4);
}

/// Drives and starts of runs at 1 kHz with a tick of delay.
struct Runs {
  int starts = 0;
  double seconds = 30;
  double within = 20;  ///< of zero [rad; rad/s]
  Vector torque_limit = limit;
  Pair unknown_torque = Pair::Zero();
};

/// The end of runs from random states.
struct Ends {
  int stay_away = 0;
  double error = 0;  ///< the largest of those that come to the reference [rad]
  double share = 0;  ///< the largest command, of its limit
};
template <class Reference>
Ends ends(const Reference& reference, const BoundedGains& gains, const Runs& runs) {
  const LoriaOrtegaBounded law(two_link_model(), gains, limited(1.5e-3, runs.torque_limit));
  std::vector<Ends> each(static_cast<std::size_t>(runs.starts));
  base::parallel_for(each.size(), [&](std::size_t i) {
    Random random(static_cast<unsigned>(i));
    const RigidArm arm;
    State<4> x = rigid_state(random.pair(runs.within), random.pair(runs.within));
    auto memory = law.start(arm.position(x), reference.at(0));
    Pair applied = Pair::Zero();
    const int ticks = static_cast<int>(runs.seconds * 1000);
    for (int k = 0; k < ticks; ++k) {
      const auto step = law.step(memory, arm.position(x), reference.at(k * 1e-3));
      memory = step.memory;
      each[i].share = std::max(
          each[i].share, step.command.tau.cwiseAbs().cwiseQuotient(runs.torque_limit).maxCoeff());
      const auto pushed = [&](double /*t*/, const State<4>& y) -> State<4> {
        return arm(y, applied + runs.unknown_torque);
      };
      for (int part = 0; part < 2; ++part) x = runge_kutta_4(pushed, 0, x, 0.5e-3);
      applied = step.command.tau;
    }
    const double error = (x.head<2>() - Pair(reference.at(ticks * 1e-3).q_ref)).norm();
    if (error < 1e-3) {
      each[i].error = error;
    } else {
      each[i].stay_away = 1;
    }
  });
  Ends all;
  for (const Ends& one : each) {
    all.stay_away += one.stay_away;
    all.error = std::max(all.error, one.error);
    all.share = std::max(all.share, one.share);
  }
  return all;
}

#ifdef __SANITIZE_ADDRESS__
constexpr int starts = 2;
#else
constexpr int starts = 40;
#endif

TEST(LoriaOrtegaBounded, ComesToTheReferenceFromStartsFarAway) {
  const auto expect_all_come = [](const auto& reference, const Vector& feedforward_max) {
    const Ends found = ends(reference, gains_with(feedforward_max), {.starts = starts});
    EXPECT_EQ(found.stay_away, 0);
    EXPECT_LE(found.share, 1 + 1e-15);
  };
  expect_all_come(Sine{{0, 0}}, vector(82, 6));
  expect_all_come(Sine{{0.5, 0.5}, 2}, vector(105, 10));
  expect_all_come(reference::trajectory::PointToPoint{vector(0, 0), vector(1.5, 0.5), 0, 1.5},
                  vector(146, 16));
}

TEST(LoriaOrtegaBounded, TakesUpAnUnknownTorqueFromStartsFarAway) {
  const Pair torque(-40, 8);
  const Ends with = ends(Sine{{0, 0}}, with_integral(vector(82, 6), vector(60, 12)),
                         {.starts = starts, .unknown_torque = torque});
  EXPECT_EQ(with.stay_away, 0);
  EXPECT_LE(with.share, 1 + 1e-15);
  // 30 s are ten time constants of the integral after the approach; another program has 1e-13.
  EXPECT_LT(with.error, 1e-9);
  const Ends without =
      ends(Sine{{0, 0}}, gains_with(vector(82, 6)), {.starts = 2, .unknown_torque = torque});
  EXPECT_EQ(without.stay_away, 2) << "d / kp is left";
}

/// Over 100 starts 40 and 0 stay away.
TEST(LoriaOrtegaBounded, NeedsSomeOfTheLimitForItsFeedback) {
  const auto away = [](const Vector& torque_limit) {
    const Ends found =
        ends(Sine{{0, 0}}, gains_with(vector(82, 6.3)),
             {.starts = starts, .seconds = 60, .within = 5, .torque_limit = torque_limit});
    EXPECT_LE(found.share, 1 + 1e-15);
    return found.stay_away;
  };
  EXPECT_GT(away(vector(95, 8)), starts / 8) << "13 % and 21 % are left";
  EXPECT_EQ(away(vector(110, 10)), 0) << "25 % and 37 % are left";
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_bounded_test
