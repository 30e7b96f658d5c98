#include "lyapunov/norm_conditions.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "linear/linear_loop.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/loops.h"
#include "tests/analysis/lyapunov/decrease.h"

// The expected numbers of conditions were computed by an independent program.
namespace tachless::lyapunov {
namespace {

using namespace linear;
using namespace linear::testing;
using namespace lyapunov::testing;

/// Closed forms at mp = 0; the table of the robot's data sheet (six digits) at both payloads.
TEST(Constants, AreThoseOfTheTwoLinkArm) {
  const struct {
    double payload, lambda_min, lambda_max, k_c;
  } rows[] = {{0, 0.447361, 9.962639, 0.838690}, {0.5, 0.657145, 12.252855, 1.660935}};
  for (const auto& row : rows) {
    const robot::Model model = robot::testing::two_link(row.payload);
    const RobotConstants c = robot_constants(model);
    EXPECT_NEAR(c.lambda_min_M.value, row.lambda_min, 1e-6);
    EXPECT_NEAR(c.lambda_max_M.value, row.lambda_max, 1e-6);
    EXPECT_NEAR(c.k_c.value, row.k_c, 1e-6);
    EXPECT_NEAR(std::abs(c.k_c.q[1]), std::numbers::pi / 2, 1e-3);
    EXPECT_NEAR(c.lambda_max_M.q[1], 0, 1e-3);
  }
}

TEST(Constants, GradientOfGravityIsThatOfTheLiterature) {
  const robot::Model model = robot::testing::two_link();
  EXPECT_NEAR(robot_constants(model).k_g.value, 81.2, 0.05);
}

TEST(Constants, OfSevenJointsAreNotExceededByRandomPostures) {
  const robot::Model model = robot::testing::iiwa7();
  const RobotConstants c = robot_constants(model);
  EXPECT_GT(c.lambda_max_M.value / c.lambda_min_M.value, 1000);
  robot::testing::Random random(5);
  for (int i = 0; i < 3000; ++i) {
    const Vector q = random.vector(7, std::numbers::pi), x = random.vector(7, 1);
    const numerics::Inertia at = numerics::inertia_at(model, q);
    const Eigen::MatrixXd C = coriolis(at, x.normalized());
    ASSERT_LE(numerics::largest_eigenvalue(at.M), c.lambda_max_M.value);
    ASSERT_GE(numerics::smallest_eigenvalue(at.M), c.lambda_min_M.value);
    ASSERT_LE(numerics::spectral_norm(C), c.k_c.value);
    ASSERT_LE(numerics::spectral_norm(linear::gradient_by_q(model, linear::constant_reference(q))),
              c.k_g.value);
  }
}

/// Norms of a state.
struct StateNorms {
  double e = 0, nu = 0, edot = 0;
  double e_minus_nu = 0;  ///< of the links
};

/// Returns what (22) prints as an upper bound of Vdot, for rigid joints. It is none: the term
/// eps (e - nu)' (Cd' - Cd) edot is missing. With `completed`, its bound
/// 2 k_c B_d eps |e - nu| |edot| is added.
double printed_decrease_bound(const ErrorSystem& s, const RobotConstants& constants, double B_d,
                              double epsilon, const StateNorms& x, bool completed) {
  const double k_c = constants.k_c.value, M_max = constants.lambda_max_M.value;
  const Eigen::VectorXd kp = s.kp.diagonal();
  const double cross =
      kp.minCoeff() * x.e * x.e - (kp.maxCoeff() + s.kd.diagonal().maxCoeff()) * x.e * x.nu -
      s.kd.diagonal().maxCoeff() * x.nu * x.nu - s.a.maxCoeff() * M_max * x.nu * x.edot +
      (s.b.minCoeff() * constants.lambda_min_M.value - M_max - k_c * x.e_minus_nu) * x.edot *
          x.edot;
  const double damping = s.kd_by_b().diagonal().cwiseProduct(s.a).minCoeff();
  double bound = -damping * x.nu * x.nu + k_c * B_d * x.edot * x.edot - epsilon * cross;
  if (completed) bound += 2 * k_c * B_d * epsilon * x.e_minus_nu * x.edot;
  return bound;
}

class NormConditions : public ::testing::Test {
 protected:
  const robot::Model model = robot::testing::two_link();
  const numerics::Postures postures{model};
  const RobotConstants constants = robot_constants(model);

  double exact_rate(const ErrorSystem& system, double eps, double q2, const Eigen::VectorXd& z) {
    Vector q(2);
    q << 0, q2;
    const Eigen::VectorXd delta = eps * (z.head(2) - z.segment(2, 2));
    return -z.dot(
        decrease_matrix(system, {eps, eps}, numerics::inertia_at(model, q), both(1), delta) * z);
  }
};

TEST_F(NormConditions, PrintedBoundsOfThePapersGains) {
  const PrintedConditions c = printed_conditions(linear::testing::rigid(paper_rigid()), constants,
                                                 linear::testing::paper_B_d);
  EXPECT_NEAR(c.eq7, 22.3, 0.05);
  EXPECT_NEAR(c.eq19, 7.9205, 5e-5);
  EXPECT_NEAR(c.eq20, 0.29636, 5e-6);
  EXPECT_NEAR(c.eq23, 0.31958, 5e-6);
  EXPECT_NEAR(c.eq24, 0.063101, 5e-7);
  EXPECT_NEAR(c.eq25, 0.0026513, 5e-8);
  EXPECT_NEAR(c.eq27, 0.39773, 5e-6);
  EXPECT_TRUE(c.feasible);
  EXPECT_NEAR(c.c1, 0.648, 5e-4);
}

TEST_F(NormConditions, AreInfeasibleForFastReferencesFlexibleJointsAndDeployableGains) {
  EXPECT_FALSE(
      printed_conditions(linear::testing::rigid(paper_rigid()), constants, 44.43).feasible);
  EXPECT_FALSE(printed_conditions(linear::testing::rigid(practical_rigid()), constants,
                                  linear::testing::paper_B_d)
                   .feasible);
  const PrintedConditions c =
      printed_conditions(linear::testing::flexible(paper_flexible(), paper_flexible()), constants,
                         linear::testing::paper_B_d);
  EXPECT_FALSE(c.feasible);
  EXPECT_NEAR(c.eq7, 99.6, 0.05);
}

TEST_F(NormConditions, AreMetByGainsThatFlatterNorms) {
  EXPECT_NEAR(
      printed_conditions(linear::testing::rigid({both(6000), both(8000), both(300), both(3000)}),
                         constants, linear::testing::paper_B_d)
          .c1,
      4.01, 5e-3);
  const FilterGains gains{both(3e4), both(5e4), both(500), both(2000)};
  EXPECT_NEAR(printed_conditions(linear::testing::flexible(gains, gains), constants,
                                 linear::testing::paper_B_d)
                  .c1,
              0.055, 5e-4);
}

/// (25) is 0 there; the other bounds know nothing of the reference.
TEST_F(NormConditions, AtAConstantReferenceHoldForAllSmallWeights) {
  const ErrorSystem system =
      linear::testing::rigid({both(6000), both(8000), both(300), both(3000)});
  const PrintedConditions moving = printed_conditions(system, constants, 1e-6);
  const PrintedConditions held = printed_conditions(system, constants, 0);
  EXPECT_EQ(held.eq25, 0);
  EXPECT_TRUE(held.feasible);
  EXPECT_EQ(held.epsilon.low, 0);
  EXPECT_NEAR(held.epsilon.high, moving.epsilon.high, 1e-6 * moving.epsilon.high);
  // c1 loses about sqrt(eq25 / eq24), 3e-4 of it at a millionth of the paper's speed.
  EXPECT_NEAR(held.c1, moving.c1, 1e-3 * held.c1);
  EXPECT_GE(held.c1, moving.c1);
}

/// Turned by an angle, gains have the same eigenvalues where a and b are those of all joints.
TEST_F(NormConditions, OfMatricesAreThoseOfTheirEigenvalues) {
  const Eigen::Matrix2d turn = Eigen::Rotation2Dd(0.6).toRotationMatrix();
  ErrorSystem turned = linear::testing::rigid(paper_rigid());
  const PrintedConditions straight =
      printed_conditions(turned, constants, linear::testing::paper_B_d);
  turned.kp = turn * turned.kp * turn.transpose();
  turned.kd = turn * turned.kd * turn.transpose();
  const PrintedConditions c = printed_conditions(turned, constants, paper_B_d);
  for (double PrintedConditions::*bound :
       {&PrintedConditions::eq19, &PrintedConditions::eq20, &PrintedConditions::eq23,
        &PrintedConditions::eq24, &PrintedConditions::eq27, &PrintedConditions::c1}) {
    EXPECT_NEAR(c.*bound, straight.*bound, 1e-12 * straight.*bound);  // rounding
  }
}

TEST_F(NormConditions, NeedAThresholdOnAHoweverLargeBIs) {
  const auto feasible = [&](double a, double b) {
    return printed_conditions(
               linear::testing::rigid({both(5000, 6000), both(7000, 8800), both(a), both(b)}),
               constants, linear::testing::paper_B_d)
        .feasible;
  };
  for (const double b : {1e3, 1e5, 1e7, 1e9}) EXPECT_FALSE(feasible(10, b)) << b;
  EXPECT_TRUE(feasible(20, 1000));
}

TEST_F(NormConditions, PrintedBound22IsViolatedAndTheCompletedOneIsNot) {
  const ErrorSystem system = linear::testing::rigid(paper_rigid());
  Eigen::VectorXd z(6);
  z << 1, 0, 0, 0, 0, 0.002;
  const StateNorms norms{1, 0, 0.002, 1};
  const double exact = exact_rate(system, 0.01, std::numbers::pi / 2, z);
  // Ten decimals are given.
  EXPECT_NEAR(exact, -49.9999941752, 6e-11);
  const double printed =
      printed_decrease_bound(system, constants, linear::testing::paper_B_d, 0.01, norms, false);
  const double completed = printed_decrease_bound(system, constants, paper_B_d, 0.01, norms, true);
  EXPECT_NEAR(printed, -50.0000127181, 1.1e-10);
  EXPECT_NEAR(completed, -49.9999652746, 1.1e-10);
  EXPECT_GT(exact, printed);
  EXPECT_LT(exact, completed);
}

TEST_F(NormConditions, VGrowsThoughEveryPrintedConditionHolds) {
  const ErrorSystem system =
      linear::testing::rigid({both(3e5), both(3e5), both(1200), both(30000, 1000)});
  const PrintedConditions c = printed_conditions(system, constants, linear::testing::paper_B_d);
  EXPECT_TRUE(c.feasible);
  const double eps = 0.0095, beta_1 = 0.3, beta_2 = 0.4, beta_3 = 0.3, gamma = 0.5;
  EXPECT_LT(eps, std::min({c.eq19, c.eq20, gamma * c.eq23, gamma * beta_1 * c.eq24, c.eq27}));
  EXPECT_GT(eps, c.eq25 / beta_3);
  EXPECT_GT(1000, c.eq7 / beta_2);
  Eigen::VectorXd z(6);
  z << 0, 0, 0, 0, 0.0667, -0.9978;
  EXPECT_NEAR(exact_rate(system, eps, 0, z), 6.62, 5e-3);
  // The smallest eigenvalue of sym(B M) is not lambda(B) lambda(M).
  const Eigen::MatrixXd BM = Eigen::VectorXd(both(100, 4000)).asDiagonal() * postures.inertia[0].M;
  EXPECT_NEAR(numerics::smallest_eigenvalue((BM + BM.transpose()) / 2), -980, 1);
  // The matrix condition refuses these gains: MatrixOfTwoLinks.GainsOfTheWrongSignAreRefused.
}

/// 100,000 random states: Vdot is below the completed (22) everywhere; the printed (22) is
/// violated.
TEST_F(NormConditions, VdotNeverExceedsTheCompletedBoundAtRandomStates) {
  const ErrorSystem system = linear::testing::rigid(paper_rigid());
  const double eps = 0.01;
  robot::testing::Random random(11);
  int printed_violated = 0;
  for (int i = 0; i < 100000; ++i) {
    const Vector q = random.vector(2, std::numbers::pi);
    const double angle = random.uniform(0, 2 * std::numbers::pi);
    const Eigen::VectorXd v_ref =
        linear::testing::paper_B_d * both(std::cos(angle), std::sin(angle));
    // Sizes over six decades.
    Eigen::VectorXd z(6);
    z << random.vector(2, std::pow(10, random.uniform(-4, 2))),
        random.vector(2, std::pow(10, random.uniform(-4, 2))),
        random.vector(2, std::pow(10, random.uniform(-4, 2)));
    if (i % 2 == 0) z.segment(2, 2).setZero();
    // The printed bound leaves no room here: e is along the joint of the smallest kp, edot is
    // small.
    if (i % 4 == 0) {
      z[1] = 0;
      z.tail(2) *= 1e-3 * std::abs(z[0]) / z.tail(2).norm();
    }
    const Eigen::VectorXd difference = z.head(2) - z.segment(2, 2);
    const Eigen::MatrixXd Mm = decrease_matrix(system, {eps, eps}, numerics::inertia_at(model, q),
                                               v_ref, eps * difference);
    const double exact = -z.dot(Mm * z);
    const StateNorms norms{z.head(2).norm(), z.segment(2, 2).norm(), z.tail(2).norm(),
                           difference.norm()};
    // Rounding of terms that cancel.
    const double rounding = 1e-12 * z.cwiseAbs().dot(Mm.cwiseAbs() * z.cwiseAbs());
    ASSERT_LE(exact,
              printed_decrease_bound(system, constants, paper_B_d, eps, norms, true) + rounding);
    printed_violated +=
        exact > printed_decrease_bound(system, constants, paper_B_d, eps, norms, false) + rounding
            ? 1
            : 0;
  }
  EXPECT_GT(printed_violated, 0);
  RecordProperty("printed_violated", printed_violated);
}

}  // namespace
}  // namespace tachless::lyapunov
