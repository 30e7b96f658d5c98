// The adaptive law: the derivative of V and of the estimates' part is as proved, and runs follow
// with loads and friction that the law does not know.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <string>
#include <vector>

#include "controller/law/loria_ortega_adaptive.h"
#include "in_process/in_process_loop.h"
#include "linear/scenario_loop.h"
#include "lyapunov/matrix_condition.h"
#include "numerics/decompositions.h"
#include "numerics/postures.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/analysis/lyapunov/decrease.h"
#include "tests/analysis/lyapunov/rate_of_v.h"
#include "tests/core/robot/robots.h"

namespace tachless::lyapunov::adaptive_law_test {
namespace {

using namespace lyapunov::testing;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// V and 1/2 pt' Gamma^-1 pt together fall by x' Mm x and change by -(edot + delta)' H e, whatever
/// the estimates are.
void expect_adaptive_identity(const robot::Model& nominal, unsigned seed) {
  robot::testing::Random random(seed);
  const Eigen::Index n = nominal.num_joints;
  controller::law::AdaptiveGains gains;
  gains.kp = gains.kd = gains.a = gains.b = Vector::Ones(n);
  gains.gamma_mass = gains.gamma_moment = gains.gamma_inertia = 1;
  const controller::law::LoriaOrtegaAdaptive law(nominal, gains, {});
  for (int i = 0; i < 1000; ++i) {
    const auto [s, w] = RandomLoop(random, n);
    const double mass = random.uniform(0.1, 3);
    const Eigen::Vector3d centre = 0.2 * Eigen::Vector3d(random.vector(3, 1)) / mass;
    const Eigen::Matrix3d any = Eigen::Matrix3d::NullaryExpr([&] { return random.uniform(-1, 1); });
    const Eigen::Matrix3d I = 0.1 * any * any.transpose();
    const robot::Model loaded = robot::with_payload(nominal, {mass, centre, I});
    const Eigen::Matrix3d at_origin =
        I +
        mass * (centre.squaredNorm() * Eigen::Matrix3d::Identity() - centre * centre.transpose());
    VectorXd pi(10);
    pi << mass, mass * centre, at_origin.diagonal(), at_origin(0, 1), at_origin(0, 2),
        at_origin(1, 2);
    if (law.columns().size() == 5) {  // a link of an arm in the plane x, z turns yy alone
      pi = VectorXd(pi.head(5));
      pi[4] = at_origin(1, 1);
    }
    ASSERT_EQ(pi.size(), std::ssize(law.columns()));
    VectorXd estimate(pi.size()), gamma(pi.size());
    for (Eigen::Index k = 0; k < pi.size(); ++k) {
      estimate[k] = pi[k] + random.uniform(-1, 1);
      gamma[k] = random.uniform(0.1, 1);
    }
    messages::ReferencePoint r = linear::constant_reference(random.vector(n, 3));
    r.v_ref = random.vector(n, 2);
    r.a_ref = random.vector(n, 5);
    const VectorXd e = random.vector(n, 0.5), edot = random.vector(n, 2), nu = random.vector(n, 3);
    const Vector q = r.q_ref + Vector(e), v = r.v_ref + Vector(edot);
    const auto load = [&](const Vector& at) -> VectorXd {
      return robot::inverse_dynamics(loaded, at, r.v_ref, r.a_ref) -
             robot::inverse_dynamics(nominal, at, r.v_ref, r.a_ref);
    };
    const MatrixXd Yd = law.columns_at(r, {r.v_ref, r.a_ref});
    const VectorXd passive = edot + w.eps_1.cwiseProduct(e) - w.eps_2.cwiseProduct(nu);
    const VectorXd tau = VectorXd(robot::inverse_dynamics(nominal, q, r.v_ref, r.a_ref)) +
                         Yd * estimate + s.damping.cwiseProduct(VectorXd(r.v_ref)) - s.kp * e -
                         s.kd * nu;
    const VectorXd bias = robot::inverse_dynamics(loaded, q, v, Vector(Vector::Zero(n)));
    const VectorXd driven = tau - s.damping.cwiseProduct(VectorXd(v)) - bias;
    const VectorXd eddot =
        numerics::solution(robot::mass_matrix(loaded, q), VectorXd(driven)).value() -
        VectorXd(r.a_ref);
    const VectorXd of_estimates = -gamma.cwiseProduct(Yd.transpose() * passive);
    RateOfV rate;
    rate.add_errors(s, w, loaded, q, v, e, edot, eddot, nu);
    rate.add((estimate - pi).dot(of_estimates.cwiseQuotient(gamma)));
    VectorXd x(3 * n);
    x << e, nu, edot;
    const MatrixXd Mm = decrease_matrix(s, w, numerics::inertia_at(loaded, q), VectorXd(r.v_ref),
                                        VectorXd(passive - edot));
    rate.add(x.dot(Mm * x));
    rate.add(passive.dot(load(q) - load(r.q_ref)));
    ASSERT_NEAR(rate.sum, 0, 1e-11 * rate.size);
  }
}

TEST(AdaptiveLaw, VdotIsTheQuadraticFormForTwoJoints) {
  expect_adaptive_identity(robot::testing::two_link(), 5);
}
TEST(AdaptiveLaw, VdotIsTheQuadraticFormForSevenJoints) {
  expect_adaptive_identity(robot::testing::iiwa7(), 6);
}

/// The largest error of each joint over the last second of a run, as its law measures it (a count
/// of 20 bits is 6e-6 rad), and the estimates at its end.
struct Tracked {
  Vector error;
  messages::LawSignals last;
};
Tracked tracked(const std::string& name, std::vector<std::string> overrides) {
  overrides.emplace_back("plant.mechanics=native");
  const scenario::Scenario scenario = linear::testing::shipped(name, overrides);
  Tracked result{Vector::Zero(scenario.num_joints), {}};
  const double end_s = scenario.loop.duration_s;
  in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
    const Vector& e = record.controller.value[0];
    if (record.time_s >= end_s - 1) result.error = result.error.cwiseMax(e.cwiseAbs());
    result.last = record.controller;
    return true;
  });
  return result;
}
/// By an independent program; 10 % is the accuracy that the comparison claims.
void expect_error(const Vector& found, Eigen::Index joint, double expected) {
  EXPECT_NEAR(found[joint], expected, 0.1 * expected);
}

const std::string rigid_law = "controller.law=loria_ortega_rigid";
const std::string rigid_gains = "controller.gains={kp: [4000, 400], kd: [300, 30], a: 300, b: 300}";

TEST(AdaptiveLaw, FollowsWithAnUnknownLoadAsIfItWereKnown) {
  const Tracked adaptive = tracked("practical_adaptive", {});
  expect_error(adaptive.error, 0, 6.7e-5);
  expect_error(adaptive.error, 1, 2.7e-4);
  EXPECT_NEAR(adaptive.last.value[3][0], 0.503, 0.002) << "mass";
  const Vector integral =
      tracked("practical_adaptive",
              {"controller.law=loria_ortega_integral",
               "controller.gains={kp: [4000, 400], kd: [300, 30], a: 300, b: 300, ki: [2000, 200], "
               "eps_1: 6, eps_2: 0.1}"})
          .error;
  expect_error(integral, 0, 2.4e-3);
  expect_error(integral, 1, 8.9e-3);
  const Vector neither = tracked("practical_adaptive", {rigid_law, rigid_gains}).error;
  expect_error(neither, 0, 3.5e-3);
  expect_error(neither, 1, 1.6e-2);
}

TEST(AdaptiveLaw, FollowsWithUnknownFrictionToo) {
  const auto braked = [](std::vector<std::string> more) {
    for (const char* each :
         {"plant.drive.viscous_friction_Nms_per_rad=[8, 1.5]", "loop.duration_s=8"}) {
      more.emplace_back(each);
    }
    return more;
  };
  const Tracked adaptive =
      tracked("practical_adaptive", braked({"controller.gains.gamma_friction=[400, 60]",
                                            "controller.gains.friction_max=[20, 5]"}));
  expect_error(adaptive.error, 0, 2.4e-5);
  expect_error(adaptive.error, 1, 6.7e-5);
  EXPECT_NEAR(adaptive.last.value[3][0], 0.497, 0.005) << "mass";
  EXPECT_NEAR(adaptive.last.value[2][0], 8.09, 0.08) << "friction";
  EXPECT_NEAR(adaptive.last.value[2][1], 1.53, 0.015);
  const Vector neither = tracked("practical_adaptive", braked({rigid_law, rigid_gains})).error;
  expect_error(neither, 0, 5.0e-3);
  expect_error(neither, 1, 2.0e-2);
}

TEST(AdaptiveLaw, OfSevenJointsFollowsWithThreeKilogramsThatItDoesNotKnow) {
  const Tracked adaptive = tracked("iiwa_adaptive", {});
  expect_error(adaptive.error, 6, 1.2e-3);
  EXPECT_NEAR(adaptive.last.value[3][0], 3.007, 0.03) << "mass";
  // A tenth of what it is; (0.09, -0.06, 0.24) kg m is the truth, which the motion excites little.
  EXPECT_NEAR(adaptive.last.value[4][0], 0.055, 0.0055);
  EXPECT_NEAR(adaptive.last.value[5][0], -0.072, 0.0072);
  EXPECT_NEAR(adaptive.last.value[6][0], 0.205, 0.0205);
  const std::string gains = "controller.gains={w: 100, damping: 0.8, a: 1000, b: 1000";
  const Vector integral =
      tracked(
          "iiwa_adaptive",
          {"controller.law=loria_ortega_integral", "loop.duration_s=4",
           gains + ", ki: [1658, 4087, 658.3, 832.9, 18.14, 16.84, 1], eps_1: 25, eps_2: 0.15}"})
          .error;
  expect_error(integral, 6, 13e-3);
  const Vector neither = tracked("iiwa_adaptive", {"controller.law=loria_ortega_scheduled",
                                                   "loop.duration_s=4", gains + "}"})
                             .error;
  expect_error(neither, 6, 59e-3);
}

}  // namespace
}  // namespace tachless::lyapunov::adaptive_law_test
