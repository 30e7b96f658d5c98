#include "controller/law/rivals/kalman_velocity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"
#include "tests/controller/law/velocity_error.h"

namespace tachless::controller::law::kalman_velocity_test {
namespace {

using Eigen::MatrixXd;

KalmanChain::Gains chain(int order, double Q, double noise) {
  return {vector(4000, 1000), vector(400, 60), vector(Q, Q), order, vector(noise, noise)};
}

const Settings at_1_khz{1e-3};

/// The filter with its covariance, step by step.
struct TimeVarying {
  MatrixXd F, G, C, Q, P;
  double R = 1;
  Eigen::VectorXd x;

  TimeVarying(int order, double density, double noise) : R(noise * noise) {
    F = MatrixXd::Zero(order, order);
    for (int i = 0; i + 1 < order; ++i) F(i, i + 1) = 1;
    G = MatrixXd::Zero(order, 1);
    G(order - 1, 0) = 1;
    C = MatrixXd::Zero(1, order);
    C(0, 0) = 1;
    Q = density * G * G.transpose();
    P = R * MatrixXd::Identity(order, order);
    x = Eigen::VectorXd::Zero(order);
  }
  /// Integrates dP/dt = F P + P F' + Q and dx/dt = F x in small steps, then takes the sample y.
  void step(double time_s, double y) {
    constexpr int pieces = 128;  // P is of the fifth degree in time: (1/128)^4 of that term
    const double dt = time_s / pieces;
    for (int i = 0; i < pieces; ++i) {
      P = runge_kutta_4(
          [&](double, const MatrixXd& p) -> MatrixXd { return F * p + p * F.transpose() + Q; }, 0,
          P, dt);
      x = runge_kutta_4([&](double, const Eigen::VectorXd& s) -> Eigen::VectorXd { return F * s; },
                        0, x, dt);
    }
    const Eigen::VectorXd K = P * C.transpose() / ((C * P * C.transpose())(0, 0) + R);
    x += K * (y - x[0]);
    P -= K * C * P;
  }
};

double position(int k) { return 0.1 * std::sin(0.02 * k) + 1e-4 * std::cos(1.7 * k); }

TEST(KalmanVelocity, IsTheTimeVaryingFilterInItsSteadyState) {
  const struct {
    int order;
    double Q;
  } rows[] = {{2, 1}, {2, 1e4}, {3, 1e2}, {3, 1e7}};
  for (const auto& row : rows) {
    constexpr double noise = 3e-5;
    const KalmanChain estimator(chain(row.order, row.Q, noise), at_1_khz);
    TimeVarying full(row.order, row.Q, noise);
    KalmanChain::Memory memory = estimator.start(vector(0, 0), Sine{{0, 0}}.at(0));
    for (int k = 0; k < 500; ++k) {
      full.step(1e-3, position(k));
      memory = estimator.step(memory, vector(position(k), 0));
    }
    // Both have forgotten their start after 0.5 s, also the slowest filter (order 3 with 1e2: 220
    // 1/s).
    EXPECT_NEAR(memory.v[0], full.x[1], 1e-9) << row.order << " " << row.Q;
    EXPECT_NEAR(memory.q[0], full.x[0], 1e-10);
    if (row.order == 3) {
      EXPECT_NEAR(memory.a[0], full.x[2], 1e-5);
    }
  }
}

KalmanVelocity law_at(double period_s, int order, double fast_per_s) {
  // The noise grows as the period shrinks: a density r of white noise in continuous time.
  constexpr double r = 1e-12;
  const double Q = r * std::pow(fast_per_s, 2 * order);
  return {two_link_model(), chain(order, Q, std::sqrt(r / period_s)), {period_s}};
}

const Sine reference{{0.5, 0.4}, 2.5};
const Pair beside(0.2, -0.2);

TEST(KalmanVelocity, Converges) {
  const auto error = [](int order) {
    const auto states = sampled_loop(law_at(1e-3, order, 200), rigid_state(beside, {0, 0}),
                                     RigidArm{}, RigidArm::position, reference, 1e-3, 3000);
    return final_error(states, reference, 1e-3, 1000);
  };
  // The filter of order 3 lags by the jerk alone, of some 8 rad/s^3, over 200^2: 2e-4 rad/s.
  EXPECT_LT(error(3), 1e-3);
  // The filter of order 2 lags by the acceleration, of 3 rad/s^2, over 200: kd * 0.015 rad/s over
  // kp.
  EXPECT_LT(error(2), 3e-3);
}

/// With w = (Q / r)^(1/(2 order)) the continuous filter's gains are those of the Butterworth
/// polynomial: (sqrt(2) w, w^2), (2 w, 2 w^2, w^3).
TEST(KalmanVelocity, ApproachesTheContinuousFiltersLoopAtFirstOrder) {
  constexpr double w = 150;
  for (const int order : {2, 3}) {
    const Pair gain = order == 2 ? Pair(std::sqrt(2) * w, w * w) : Pair(2 * w, 2 * w * w);
    const auto rate = [&](double t, const State<10>& x) {
      const Pair q = x.head<2>(), v_hat = x.segment<2>(6), a_hat = x.tail<2>();
      const Pair tau = wen_bayard_torque(reference.at(t), q, v_hat, {4000, 1000}, {400, 60});
      const Pair off = q - x.segment<2>(4);
      State<10> dot;
      dot << RigidArm{}(x.head<4>(), tau), v_hat + gain[0] * off, a_hat + gain[1] * off,
          (order == 3 ? w * w * w : 0) * off;
      return dot;
    };
    const messages::ReferencePoint first = reference.at(0);
    State<10> x0;
    x0 << beside, 0, 0, beside, first.v_ref, first.a_ref;
    if (order == 2) x0.tail<2>().setZero();
    expect_first_order([&](double h) { return law_at(h, order, w); }, RigidArm::position, rate, x0,
                       reference, 5e-4);
  }
}

TEST(KalmanVelocity, HasTheVelocityErrorOfItsOrderAtItsBestTuning) {
  const double noise = count_16_bit / std::sqrt(12);
  const auto best = [&](int order, double from, double to) {
    double least = 1;
    for (double Q = from; Q <= to; Q *= 1.8) {
      least = std::min(least, velocity_error(KalmanChain(chain(order, Q, noise), at_1_khz)));
    }
    return least;
  };
  // The values are from an independent simulation.
  EXPECT_NEAR(best(2, 0.01, 100), 0.028, 0.0028);
  EXPECT_NEAR(best(3, 1e2, 1e6), 0.0096, 0.00096);
}

TEST(KalmanVelocity, TakesTheEncodersNoiseAndSaysWhatIsMissingWithoutIt) {
  KalmanChain::Gains gains = chain(2, 1, 1);
  gains.measurement_noise = {};
  Settings settings = at_1_khz;
  settings.position_std = vector(1e-4, 2e-4);
  const messages::ReferencePoint rest = Sine{{0, 0}}.at(0);
  KalmanChain::Gains given = gains;
  given.measurement_noise = settings.position_std;
  const Vector q = vector(0.1, 0.1);
  const auto first = [&](const KalmanChain& chain) {
    return chain.velocity(chain.step(chain.start(vector(0, 0), rest), q));
  };
  EXPECT_EQ(first(KalmanChain(gains, settings)), first(KalmanChain(given, at_1_khz)));
  try {
    KalmanChain(gains, at_1_khz);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& problem) {
    EXPECT_THAT(problem.what(), testing::AllOf(testing::HasSubstr("measurement_noise is missing"),
                                               testing::HasSubstr("resolution_bits")));
  }
}

TEST(KalmanVelocity, StartsAtTheReferencesVelocity) {
  for (const int order : {2, 3}) {
    const KalmanVelocity law = law_at(1e-3, order, 200);
    const messages::PositionMeasurement measured{vector(0.3, 0.4)};
    const messages::ReferencePoint now = reference.at(0.1);
    const auto step = law.step(law.start(measured, now), measured, now);
    EXPECT_LT((step.signals.value[1] - now.v_ref).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace tachless::controller::law::kalman_velocity_test
