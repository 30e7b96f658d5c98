#include "linear/sampled_limit.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "numerics/decompositions.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/linear_laws.h"
#include "tests/analysis/linear/loops.h"

// The expected numbers were computed by an independent program, at q = 0.
namespace tachless::linear {
namespace {

using namespace linear::testing;
using controller::law::Discretisation;
using Eigen::VectorXd;

constexpr Discretisation zoh = Discretisation::zero_order_hold, tustin = Discretisation::tustin,
                         foh = Discretisation::first_order_hold,
                         backward = Discretisation::backward_euler;

SampledLoop rigid_loop(const controller::law::FilterGains& gains, Discretisation kind, int delay,
                       const robot::Model& model, const Vector& q) {
  const Eigen::MatrixXd gradient = gradient_by_q(model, constant_reference(q));
  return {rigid_plant(model, constant_reference(q)),
          [=](double h) {
            return linear_rigid_law(gains, gradient, {kind, h});
          },
          delay};
}
SampledLoop flexible_loop(const controller::law::FilterGains& link,
                          const controller::law::FilterGains& motor, Discretisation kind, int delay,
                          const robot::Model& model, const Vector& q) {
  return {flexible_plant(model, constant_reference(q), stiffness(), rotors()),
          [=](double h) {
            return linear_flexible_law(model, q, stiffness(), rotors(), link, motor, {kind, h});
          },
          delay};
}

class SampledLimit : public ::testing::Test {
 protected:
  const robot::Model model = robot::testing::two_link();
  const Vector q0 = both(0);

  SampledLoop rigid(const controller::law::FilterGains& gains, Discretisation kind,
                    int delay) const {
    return rigid_loop(gains, kind, delay, model, q0);
  }
  SampledLoop flexible(const controller::law::FilterGains& link,
                       const controller::law::FilterGains& motor, Discretisation kind,
                       int delay) const {
    return flexible_loop(link, motor, kind, delay, model, q0);
  }
};

TEST_F(SampledLimit, OfThePapersGainsForEveryFilterAndDelay) {
  const struct {
    Discretisation kind;
    double rigid_0, rigid_1, flexible_0, flexible_1;
  } rows[] = {{zoh, 9.7123e-05, 3.3652e-05, 1.7545e-05, 5.8814e-06},
              {tustin, 1.0191e-04, 3.4224e-05, 1.7679e-05, 5.8964e-06},
              {foh, 1.0191e-04, 3.4224e-05, 1.7679e-05, 5.8964e-06},
              {backward, 1.0190e-04, 3.4219e-05, 1.7702e-05, 5.8990e-06}};
  for (const auto& row : rows) {
    const double limits[] = {row.rigid_0, row.rigid_1, row.flexible_0, row.flexible_1};
    for (int i = 0; i < 4; ++i) {
      const auto limit = largest_stable_period(
          i < 2 ? rigid(paper_rigid(), row.kind, i % 2)
                : flexible(paper_flexible(), paper_flexible(), row.kind, i % 2));
      ASSERT_TRUE(limit) << i;
      EXPECT_NEAR(*limit, limits[i], 5e-5 * limits[i]) << i;  // five digits are quoted
    }
  }
}

TEST_F(SampledLimit, OfGainsThatRunAtOneKilohertz) {
  const controller::law::FilterGains g = practical_rigid(), l = practical_link(),
                                     m = practical_motor();
  EXPECT_NEAR(*largest_stable_period(rigid(g, tustin, 0)), 8.93e-3, 5e-6);
  EXPECT_NEAR(*largest_stable_period(rigid(g, foh, 0)), 7.27e-3, 5e-6);
  EXPECT_NEAR(*largest_stable_period(rigid(g, backward, 0)), 6.86e-3, 5e-6);
  EXPECT_NEAR(*largest_stable_period(rigid(g, zoh, 0)), 2.98e-3, 5e-6);
  EXPECT_NEAR(*largest_stable_period(rigid(g, tustin, 1)), 3.6e-3, 5e-5);
  EXPECT_NEAR(*largest_stable_period(flexible(l, m, tustin, 0)), 4.1e-3, 5e-5);
  EXPECT_NEAR(*largest_stable_period(flexible(l, m, tustin, 1)), 1.5e-3, 5e-5);
}

/// Full-state laws and the dirty derivative on one joint, in closed form.
TEST_F(SampledLimit, AgreesWithTheRulesOfOneJoint) {
  const double M = 2, kd = 50, a = 80, b = 120;
  LinearPlant plant{Eigen::Matrix2d{{0, 1}, {0, 0}}, Eigen::Vector2d(0, 1 / M), 1};
  const auto one = [](double x) { return VectorXd::Constant(1, x); };
  for (const Discretisation kind : {tustin, foh, backward}) {
    const controller::law::FilterGains g{one(1e-6), one(kd), one(a), one(b)};  // Kp to 0
    const Eigen::MatrixXd none = Eigen::MatrixXd::Zero(1, 1);
    const auto law = [=](double h) { return linear_rigid_law(g, none, {kind, h}); };
    const double rule = 2 * a / (kd * b / M);
    EXPECT_NEAR(*largest_stable_period({plant, law, 0}, 1e-4), rule, 1e-5 * rule);
    // One period of delay: the same times a factor of the filter's phi at the limit.
    const double limit = *largest_stable_period({plant, law, 1}, 1e-4);
    const double phi = controller::law::filter_coefficients(kind, a, b, limit).phi;
    const double factor = (std::sqrt(phi * phi + 8) - 2 - phi) / (2 * (1 - phi));
    EXPECT_NEAR(limit, rule * factor, 1e-4 * rule);
  }
  const auto full_state = [=](double kp, double kv) {
    LinearLaw law{Eigen::MatrixXd(0, 0),
                  Eigen::MatrixXd(0, 2),
                  Eigen::MatrixXd(1, 0),
                  Eigen::MatrixXd{{-kp * M, -kv * M}},
                  {Part::q, Part::v}};
    return [law](double) { return law; };
  };
  for (const auto& [kp, kv] : {std::pair{100.0, 20.0}, std::pair{3000.0, 20.0}}) {
    const double limit = *largest_stable_period({plant, full_state(kp, kv), 0});
    EXPECT_NEAR(limit, std::min(2 * kv / kp, 2 / kv), 1e-6);
  }
  EXPECT_NEAR(*largest_stable_period({plant, full_state(1e-4, 20), 1}, 1e-4), 1.0 / 20, 1e-5);
}

/// From a stable period upwards, from an unstable one downwards.
TEST_F(SampledLimit, IsTheOneNextToWhereItIsSought) {
  const SampledLoop loop = rigid(practical_rigid(), tustin, 0);
  for (const double from_s : {1e-7, 1e-3, 2e-2}) {
    const double limit = *largest_stable_period(loop, from_s);
    EXPECT_NEAR(limit, 8.93e-3, 5e-6) << from_s;  // as above
    EXPECT_LT(radius_at(loop, limit), 1);
    EXPECT_GE(radius_at(loop, limit * (1 + 1e-6)), 1);  // by 17 halvings of a tenth
  }
  SampledLoop reversed = loop;
  reversed.plant.B *= -1;
  EXPECT_FALSE(largest_stable_period(reversed, 1e-3));
}

/// A window of instability of 1.7 %, which steps of a tenth pass over.
TEST_F(SampledLimit, FindsANarrowWindowOfInstability) {
  const double window_s = 3.07e-3;
  const auto law = [=](double h) {
    const double x = (h / window_s - 1) / 8e-3, kp = 100 * (1 - 3 * std::exp(-x * x));
    return LinearLaw{Eigen::MatrixXd(0, 0),
                     Eigen::MatrixXd(0, 2),
                     Eigen::MatrixXd(1, 0),
                     Eigen::MatrixXd{{-kp, -20}},
                     {Part::q, Part::v}};
  };
  const SampledLoop loop{{Eigen::Matrix2d{{0, 1}, {0, 0}}, Eigen::Vector2d(0, 1), 1}, law, 0};
  EXPECT_NEAR(*largest_stable_period(loop, 1e-3), window_s * (1 - 8e-3 * std::sqrt(std::log(3.0))),
              1e-6);
}

TEST_F(SampledLimit, RuleOfThumbIsUnsafeWithKp) {
  const controller::law::FilterGains g = practical_rigid();
  const Eigen::MatrixXd loop_gain = numerics::inverse(robot::mass_matrix(model, q0)) *
                                    VectorXd(g.kd.cwiseProduct(g.b)).asDiagonal();
  const double largest = numerics::eigenvalues(loop_gain).cwiseAbs().maxCoeff();
  EXPECT_NEAR(2 * 1000 / largest, 9.74e-3, 5e-6);
}

TEST_F(SampledLimit, ModesAndMarginsAtOneKilohertz) {
  const controller::law::FilterGains g = practical_rigid(), l = practical_link(),
                                     m = practical_motor();
  const controller::law::FilterGains soft_l{both(12000, 1000), both(500, 25), both(250), both(250)};
  const controller::law::FilterGains soft_m{both(100), both(12, 16), both(1000), both(1000)};
  const struct {
    SampledLoop loop;
    double decay, modulus, gain, phase_deg, delay_s;
  } rows[] = {{rigid(g, tustin, 0), 35.7, 0.77, 9.1, 57, 5.1e-3},
              {rigid(g, tustin, 1), 37.0, 0.61, 3.5, 50, 4.1e-3},
              {flexible(l, m, tustin, 0), 27.1, 0.65, 7.8, 45, 1.8e-3},
              {flexible(l, m, tustin, 1), 27.7, 0.31, 2.3, 20, 0.79e-3},
              {flexible(soft_l, soft_m, tustin, 1), 22, 0.35, 2.85, 23, 0.94e-3}};
  for (const auto& row : rows) {
    const Modes at = modes(row.loop, 1e-3);
    EXPECT_TRUE(at.stable);
    EXPECT_NEAR(at.decay_per_s, row.decay, 0.06);
    EXPECT_NEAR(at.radius, std::exp(-1e-3 * at.decay_per_s), 1e-12);
    // One slow mode needs ln 100; more of them, or one that the error does not begin in, another
    // time.
    EXPECT_GT(at.settling_s, 0.5 * std::log(100) / at.decay_per_s);
    EXPECT_LT(at.settling_s, 2 * std::log(100) / at.decay_per_s);
    const Margins margin = margins(row.loop, 1e-3);
    // Quoted with two digits. Gain margins are quoted up to 2 % and moduli up to 3 % off what is
    // seen here, where MarginsAreThoseOfTheLoopItself stands by it.
    EXPECT_NEAR(margin.modulus, row.modulus, 0.015);
    EXPECT_LT(margin.modulus_independent, margin.modulus);
    EXPECT_NEAR(margin.gain, row.gain, 0.025 * row.gain);
    EXPECT_NEAR(margin.phase_deg, row.phase_deg, 0.55);
    EXPECT_NEAR(margin.delay_s, row.delay_s, 0.012 * row.delay_s);
  }
}

/// Each margin is where the loop itself turns unstable.
TEST_F(SampledLimit, MarginsAreThoseOfTheLoopItself) {
  const SampledLoop loop = rigid(practical_rigid(), tustin, 0);
  const Margins margin = margins(loop, 1e-3);
  const auto radius = [&](int delay, double gain) {
    return spectral_radius(cut(loop.plant, loop.law(1e-3), 1e-3, delay).closed(gain));
  };
  EXPECT_LT(radius(0, 0.999 * margin.gain), 1);
  EXPECT_GT(radius(0, 1.001 * margin.gain), 1);
  const int whole = static_cast<int>(std::floor(margin.delay_s / 1e-3));
  EXPECT_LT(radius(whole, 1), 1);
  EXPECT_GT(radius(whole + 1, 1), 1);
}

// A joint that gravity pulls away with 50 N m/rad needs kp above 50: its pole leaves through z = 1,
// which is no frequency of the grid. The larger gain ends at z = -1.
TEST(GainMargins, AreFoundAtBothEndsOfTheUnitCircle) {
  Eigen::MatrixXd A(2, 2), B(2, 1), D(1, 2);
  A << 0, 1, 50, 0;
  B << 0, 1;
  D << -200, -20;
  const LinearLaw law{
      Eigen::MatrixXd(0, 0), Eigen::MatrixXd(0, 2), Eigen::MatrixXd(1, 0), D, {Part::q, Part::v}};
  const SampledLoop loop{{A, B, 1}, [law](double) { return law; }, 0};
  constexpr double h = 1e-2;
  const Margins found = margins(loop, h);
  EXPECT_NEAR(found.least_gain, 0.25, 1e-6);
  ASSERT_TRUE(std::isfinite(found.gain));
  const CutLoop open = cut(loop, h);
  EXPECT_LT(spectral_radius(open.closed(0.9999 * found.gain)), 1);
  EXPECT_GT(spectral_radius(open.closed(1.0001 * found.gain)), 1);
}

/// A motor's loop over a spring of 50,000 N m/rad that is hardly damped: |L| is above 1 between two
/// frequencies of a grid alone.
TEST_F(SampledLimit, DelayMarginIsThatOfANarrowResonance) {
  const double M = 1, J = 0.1, K = 5e4, damping = 0.02, h = 5e-4;
  Eigen::MatrixXd A(4, 4), B(4, 1);
  A << 0, 1, 0, 0, -K / M, 0, K / M, 0, 0, 0, 0, 1, K / J, 0, -K / J, -damping / J;
  B << 0, 0, 0, 1 / J;
  const LinearPlant plant{A, B, 1};
  const auto one = [](double x) { return VectorXd::Constant(1, x); };
  const controller::law::FilterGains g{one(30), one(0.5), one(50), one(50)};
  const auto law = [=](double period_s) {
    LinearLaw of_motor = linear_rigid_law(g, Eigen::MatrixXd::Zero(1, 1), {tustin, period_s});
    of_motor.measured = {Part::theta};
    return of_motor;
  };
  ASSERT_LT(radius_at({plant, law, 0}, h), 1);
  ASSERT_GT(radius_at({plant, law, 1}, h), 1);
  const Margins margin = margins({plant, law, 0}, h);
  EXPECT_LT(margin.delay_s, h);  // that delay makes it unstable
  EXPECT_GT(margin.delay_s, 0.1 * h);
}

/// A mode of 1 rad/s, sampled at 1 GHz.
TEST_F(SampledLimit, FrequenciesBeginBelowTheSlowestMode) {
  const double h = 1e-9;
  const Eigen::VectorXcd pole = Eigen::VectorXcd::Constant(1, std::exp(-h));
  EXPECT_LT(frequencies(pole, h, 100).front(), 1);
}

TEST_F(SampledLimit, TorqueOfAnEncoderCountIsTheLawsOwnGain) {
  const LinearLaw law = rigid(practical_rigid(), tustin, 0).law(1e-3);
  // Kp + Kd beta, less the gradient of gravity.
  EXPECT_NEAR(-law.D(0, 0), 0.71e6, 0.005e6);
}

TEST_F(SampledLimit, AlongAMotionIsTheFrozenOneWhenNothingMoves) {
  const SampledLoop loop = rigid(practical_rigid(), tustin, 1);
  const Eigen::MatrixXd map = cut(loop.plant, loop.law(1e-3), 1e-3, 1).closed();
  EXPECT_NEAR(radius_along([&](int) { return map; }, 200), spectral_radius(map), 1e-9);
}

TEST_F(SampledLimit, AlongThePapersReference) {
  const controller::law::FilterGains g = practical_rigid();
  const double w = 10 * std::numbers::pi, h = 1e-3;
  const auto point = [&](double t) {
    return messages::ReferencePoint{
        both(std::sin(w * t) / w), both(std::cos(w * t)), both(-w * std::sin(w * t)), {}, {}};
  };
  const double radius = radius_along(
      [&](int k) {
        const LinearLaw law = linear_rigid_law(g, gradient_by_q(model, point(k * h)), {tustin, h});
        return cut(rigid_plant(model, point((k + 0.5) * h)), law, h, 1).closed();
      },
      200);
  // The motion is small: near the loop's at rest, exp(-0.037).
  EXPECT_NEAR(-std::log(radius) / h, 37.0, 2);
}

TEST(SampledLimitOfSevenJoints, IsFoundWithModesAndMargins) {
  const robot::Model model = robot::testing::iiwa7();
  Vector q(7);
  q << 0, 0.3, 0, -1.0, 0, 0.8, 0;
  const SampledLoop loop = rigid_loop(iiwa_gains(), tustin, 0, model, q);
  EXPECT_GT(largest_stable_period(loop, 1e-3).value(), 4e-3);
  EXPECT_TRUE(modes(loop, 1e-3).stable);
  EXPECT_GT(margins(loop, 1e-3).phase_deg, 20);
}

/// A matrix with real eigenvalues and complex pairs, against one linear system for each frequency.
TEST(FrequencyResponse, IsTheResolventBetweenInputAndOutput) {
  constexpr Eigen::Index states = 7, inputs = 3, outputs = 2;
  const auto filled = [](Eigen::Index rows, Eigen::Index columns, double by) {
    Eigen::MatrixXd all(rows, columns);
    for (Eigen::Index i = 0; i < rows * columns; ++i) {
      all(i % rows, i / rows) = std::sin(by * static_cast<double>(i + 1));
    }
    return all;
  };
  const Eigen::MatrixXd A = filled(states, states, 2.3), B = filled(states, inputs, 1.1),
                        C = filled(outputs, states, 0.7);
  const Eigen::VectorXcd poles = numerics::eigenvalues(A);
  const auto is_real = [](const std::complex<double>& pole) { return pole.imag() == 0; };
  ASSERT_GT(std::ranges::count_if(poles, is_real), 0);
  ASSERT_LT(std::ranges::count_if(poles, is_real), states);
  const FrequencyResponse response(numerics::real_schur(A), B, C);
  for (const double angle : {0.01, 0.8, 3.0}) {
    const std::complex<double> z = std::polar(1.0, angle);
    const Eigen::MatrixXcd resolvent = numerics::complex_inverse(
        Eigen::MatrixXcd(z * Eigen::MatrixXcd::Identity(states, states) - A));
    const Eigen::MatrixXcd expected = C * resolvent * B;
    EXPECT_LT((response.at(z) - expected).norm(), 1e-12 * expected.norm());  // rounding
  }
}

}  // namespace
}  // namespace tachless::linear
