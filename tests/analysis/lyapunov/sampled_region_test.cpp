#include "lyapunov/sampled_region.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "base/failure.h"
#include "base/json_text.h"
#include "base/parallel.h"
#include "in_process/in_process_loop.h"
#include "lyapunov/witness.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::lyapunov::sampled_region_test {
namespace {

using namespace linear;
using namespace linear::testing;
using Eigen::VectorXd;

/// At 1 kHz with one tick of delay, held at rest at q.
scenario::Scenario held_at(const std::string& q, std::vector<std::string> more = {}) {
  more.insert(more.end(),
              {"reference={hold: {position_rad: " + q + "}}", "plant.encoder.resolution_bits=null",
               "plant.mechanics=native", "loop.duration_s=0.4", "plant.initial.torque=hold"});
  return linear::testing::shipped("practical_rigid", more);
}

SampledRegion region_of(const scenario::Scenario& scenario) {
  std::string why_not;
  auto region = sampled_region(scenario, why_not);
  if (!region) throw std::runtime_error(why_not);
  return *region;
}

TEST(OneTick, HasTheLinearLoopAsItsGradient) {
  const OneTick F(held_at("[0.3, 0.8]"), Eigen::Vector2d(0.3, 0.8));
  const Eigen::MatrixXd A = F.linear();
  ASSERT_EQ(A.rows(), 10);  // q, v, nu, e before, torque under way
  const VectorXd scale = (VectorXd(10) << 1, 1, 40, 40, 40, 40, 1, 1, 4e4, 2400).finished();
  EXPECT_LT(F(VectorXd::Zero(10)).cwiseQuotient(scale).norm(), 1e-12);
  for (Eigen::Index i = 0; i < 10; ++i) {
    const VectorXd dx = 1e-5 * scale[i] * VectorXd::Unit(10, i);
    const VectorXd column = (F(dx) - F(-dx)) / (2e-5 * scale[i]);
    // Differences of rounded values, 1e-16 / 1e-5, and of the third order.
    EXPECT_LT((column - A.col(i)).cwiseQuotient(scale).norm() * scale[i], 1e-7) << i;
  }
}

/// Current loops are states of their own; rest is at the reference whatever the torques' scale.
TEST(OneTick, OfLaggingScaledDrivesHasTheLinearLoopAsItsGradient) {
  for (const bool flexible : {false, true}) {
    const scenario::Scenario scenario = linear::testing::shipped(
        flexible ? "practical_flexible" : "practical_rigid",
        {"loop.period_s=1e-3", "loop.command_delay=2", "plant.encoder.resolution_bits=null",
         "reference={hold: {position_rad: [0.3, 0.8]}}", "loop.duration_s=0.4",
         "plant.drive.current_loop_hz=[100, 60]", "plant.drive.torque_scale=[1.1, 0.9]",
         "plant.integrator.accuracy=1e-12"});
    const OneTick F(scenario, Eigen::Vector2d(0.3, 0.8));
    const Eigen::MatrixXd A = F.linear();
    const Eigen::Index size = A.rows();
    ASSERT_EQ(F.plant_size(), flexible ? 10 : 6);
    EXPECT_LT(F(VectorXd::Zero(size)).norm(), 1e-8);
    for (Eigen::Index i = 0; i < size; ++i) {
      const double step = 1e-5;
      const VectorXd dx = step * VectorXd::Unit(size, i);
      const VectorXd column = (F(dx) - F(-dx)) / (2 * step);
      // The integrator's 1e-12 over the step, differences of the law, and the third order.
      const VectorXd error =
          (column - A.col(i)).cwiseAbs() - 1e-6 * A.cwiseAbs().rowwise().maxCoeff();
      EXPECT_LT(error.maxCoeff(), 1e-6) << flexible << " " << i;
    }
  }
}

/// Published figures of an independent program at q = 0: 1.22 and 2.39 rad.
TEST(SampledRegion, OfTheTwoLinkArmAtOneKilohertz) {
  const SampledRegion region = region_of(held_at("[0, 0]"));
  std::cout << region.e_at_rest.transpose() << " | " << region.edot.transpose() << " widest "
            << region.widest << "\n";
  EXPECT_GE(region.e_at_rest[0], 1.2);
  EXPECT_GE(region.e_at_rest[1], 2.3);
  EXPECT_GE(region.directions, 4000);
  EXPECT_FALSE(region.cut);
}

TEST(SampledRegion, IsNotClaimedWhereThereIsNone) {
  std::string why_not;
  EXPECT_FALSE(sampled_region(held_at("[0, 0]", {"loop.period_s=0.01"}), why_not));
  EXPECT_THAT(why_not, ::testing::HasSubstr("unstable"));
  EXPECT_FALSE(
      sampled_region(held_at("[0, 0]", {"plant.drive.coulomb_friction_Nm=[1, 1]"}), why_not));
  EXPECT_THAT(why_not, ::testing::HasSubstr("friction"));
  EXPECT_FALSE(sampled_region(
      linear::testing::shipped("practical_flexible",
                               {"robot.joints.flexible.motor_coulomb_friction_Nm=1"}),
      why_not));
  EXPECT_THAT(why_not, ::testing::HasSubstr("friction"));
}

/// The loop as coded keeps the claim of check_witness.py: |F(x)| <= rho |x| + gamma where |x| <= 1.
TEST(Witness, HoldsOfTheOneTickMapAsCoded) {
  const scenario::Scenario held = held_at("[0, 1.5]", {"plant.encoder.resolution_bits=20"});
  const auto json = base::parse_json(witness(held, Vector(Eigen::Vector2d(0.3, 0.6))));
  Eigen::MatrixXd L(8, 8);
  for (int i = 0; i < 64; ++i) L(i / 8, i % 8) = json["L"][i / 8][i % 8];
  const OneTick F(held, Eigen::Vector2d(0, 1.5));
  const double phi = json["phi"][0], beta = json["beta"][0], rho = json["rho"];
  const auto size = [&](const VectorXd& x) {  // of (q, v, nu, e before, torque)
    VectorXd z(8);
    z << x.head(4), phi * x.segment(4, 2) - beta * x.segment(6, 2), x.tail(2);
    return (L.transpose() * z).norm();
  };
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  double largest = 0;
  for (int k = 0; k < 3000; ++k) {
    const VectorXd y = VectorXd::NullaryExpr(8, [&] { return normal(random); }).normalized();
    const VectorXd z = L.transpose().triangularView<Eigen::Upper>().solve(y);
    VectorXd x = VectorXd::Zero(10);
    x << z.head(4), z.segment(4, 2) / phi, 0, 0, z.tail(2);
    ASSERT_NEAR(size(x), 1, 1e-9);
    largest = std::max(largest, size(F(x)));
  }
  std::cout << "largest growth " << largest << " of " << rho << "\n";
  EXPECT_LE(largest, rho);
  EXPECT_GT(largest, 0.9);  // somewhere the loop is as slow as that
  // A joint without a limit beside one that has one: JSON has no infinity.
  scenario::Scenario limited = held;
  limited.plant.drive.torque_limit_Nm = Eigen::Vector2d(1e5, infinity);
  const auto written =
      base::parse_json(witness(limited, Vector(Eigen::Vector2d(0.3, 0.6))))["torque_limit"];
  EXPECT_EQ(written[0], 1e5);
  EXPECT_GT(written[1], 1e300);
  EXPECT_THROW((void)witness(linear::testing::shipped("iiwa_point_to_point"),
                             Vector(Vector::Constant(7, 0.3))),
               base::Failure);
  EXPECT_THROW((void)witness(held, Vector(Eigen::Vector2d(30, 30))), base::Failure);
  // Its errors are those of a filter that is at rest at the start.
  scenario::Scenario kicked = held;
  kicked.controller.filter_start = controller::law::FilterStart::zero;
  EXPECT_THROW((void)witness(kicked, Vector(Eigen::Vector2d(0.3, 0.6))), base::Failure);
}

/// The loop of a run, from random directions of (q, v) on the boundary, as many as
/// TACHLESS_MONTE_CARLO says.
void expect_none_leaves(const scenario::Scenario& held, std::size_t runs) {
  if (const char* given = std::getenv("TACHLESS_MONTE_CARLO")) runs = std::stoul(given);
  const SampledRegion region = region_of(held);
  std::cout << region.e_at_rest.transpose() << " | " << region.edot.transpose() << std::endl;
  const OneTick F(held, region.q_ref);
  const Eigen::Index n = held.num_joints;
  struct Descent {
    double V0 = 0, end = 0, largest_growth = 0, torque_share = 0;
    std::int64_t tick = 0;  ///< of the largest growth
  };
  std::vector<Descent> descents(runs);
  base::parallel_for(runs, [&](std::size_t i) {
    std::mt19937_64 random(i + 1);
    std::normal_distribution<double> normal;
    VectorXd plant(2 * n);
    plant << region.e_at_rest, region.edot;
    plant.array() *= VectorXd::NullaryExpr(2 * n, [&] { return normal(random); }).array();
    const auto gravity = [&](const Vector& q) { return robot::gravity_torque(*held.model, q); };
    const auto start = [&](double by) {  // under way the torque that holds the start
      VectorXd x = F.start(by * plant);
      x.tail(n) = gravity(region.q_ref + by * plant.head(n)) - gravity(region.q_ref);
      return x;
    };
    double by = 1;
    for (int k = 0; k < 60; ++k) by /= std::sqrt(region.V(start(by)));  // nearly quadratic
    plant *= by;
    scenario::Scenario scenario = held;
    scenario.plant.initial.position_rad = region.q_ref + plant.head(n);
    scenario.plant.initial.velocity_rad_per_s = plant.tail(n);
    scenario.plant.initial.torque = plant::InitialTorque::hold;
    VectorXd memory;
    double before = infinity;
    Descent& descent = descents[i];
    in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
      VectorXd x = VectorXd::Zero(5 * n);
      x.head(2 * n) << record.truth.q - region.q_ref, record.truth.v;
      x.segment(2 * n, 2 * n) =
          record.tick == 0 ? VectorXd(F.start(plant).segment(2 * n, 2 * n)) : memory;
      x.tail(n) = record.applied.tau - gravity(region.q_ref);
      memory = x.segment(2 * n, 2 * n);
      memory << record.controller.value[1], record.controller.value[0];
      if (const auto& limit = held.plant.drive.torque_limit_Nm) {
        descent.torque_share = std::max(
            descent.torque_share, record.command.tau.cwiseQuotient(*limit).cwiseAbs().maxCoeff());
      }
      const double V = region.V(x);
      if (record.tick == 0) descent.V0 = V;
      if (V > 1e-12 && V / before > descent.largest_growth) {
        descent.largest_growth = V / before;
        descent.tick = record.tick;
      }
      before = descent.end = V;
      return V > 1e-7;
    });
  });
  double growth = 0, share = 0;
  for (const Descent& each : descents) {
    EXPECT_NEAR(each.V0, 1, 1e-9);
    EXPECT_LT(each.largest_growth, 1) << "at tick " << each.tick;
    EXPECT_LT(each.end, 1e-6);
    growth = std::max(growth, each.largest_growth);
    share = std::max(share, each.torque_share);
  }
  std::cout << runs << " starts: V falls to " << growth
            << " of it in a tick at least, torque up to " << share << " of a limit\n";
}

TEST(SampledRegion, IsLeftByNoRunFromItsBoundaryAndAllConverge) {
  expect_none_leaves(held_at("[0, 0]"), 1000);
}

TEST(SampledRegion, WithTorqueLimitsIsLeftByNoRun) {
  expect_none_leaves(held_at("[0, 0]", {"plant.drive.torque_limit_Nm=[20000, 5000]"}), 300);
}

TEST(SampledRegion, OfSevenJointsIsLeftByNoRun) {
  expect_none_leaves(linear::testing::shipped(
                         "iiwa_point_to_point",
                         {"reference={hold: {position_rad: [0.3, 0.5, 0, -1.2, 0, 0.8, 0]}}",
                          "plant.encoder.resolution_bits=null", "plant.mechanics=native",
                          "plant.on_limit=warn", "loop.duration_s=3", "loop.command_delay=1"}),
                     20);
}

}  // namespace
}  // namespace tachless::lyapunov::sampled_region_test
