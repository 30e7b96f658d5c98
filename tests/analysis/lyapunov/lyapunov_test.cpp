#include "linear/scenario_loop.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "controller/registry.h"
#include "controller/stepped_law.h"
#include "in_process/in_process_loop.h"
#include "lyapunov/stability_certificate.h"
#include "numerics/decompositions.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "scenario/scenario.h"
#include "tests/core/robot/robots.h"

namespace tachless::lyapunov {
namespace {

using namespace linear;
using controller::law::LoopState;

scenario::Scenario scenario(const std::string& file,
                            const std::vector<std::string>& overrides = {}) {
  return scenario::load_scenario(std::string(TACHLESS_SOURCE_DIR "/scenarios/") + file, overrides);
}

class Random {
 public:
  Vector vector(int n, double size) {
    Vector x(n);
    for (double& value : x) value = size * uniform_(random_);
    return x;
  }
  messages::ReferencePoint reference(int n) {
    return {vector(n, 1), vector(n, 1), vector(n, 10), vector(n, 50), vector(n, 100)};
  }

 private:
  std::mt19937_64 random_{11};
  std::uniform_real_distribution<double> uniform_{-1, 1};
};

LoopState rigid_state(Random& random) {
  LoopState state{random.vector(2, 2), random.vector(2, 3), {}, {}, {}};
  state.controller.num = 2;
  state.controller.value[1] = random.vector(2, 5);
  return state;
}

TEST(Lyapunov, IsEquation15AsAQuadraticForm) {
  const scenario::Scenario experiment = scenario("paper_rigid.yaml");
  const auto certified = certified_run(experiment);
  ASSERT_TRUE(certified);
  const auto& [eps_1, eps_2] = certified->weights;
  EXPECT_GT(eps_1.minCoeff(), 0);
  EXPECT_GT(eps_2.minCoeff(), 0);
  const auto V = controller::lyapunov_function(experiment, certified->weights);
  ASSERT_TRUE(V);
  const robot::Model model = controller::rigid_model(experiment);
  Random random;
  for (int k = 0; k < 200; ++k) {
    const LoopState x = rigid_state(random);
    const messages::ReferencePoint r = random.reference(2);
    // 1/2 z' P z with z = (edot, e, nu), P written out.
    const Eigen::Matrix2d M = robot::mass_matrix(model, x.q);
    Eigen::Matrix<double, 6, 6> P = Eigen::Matrix<double, 6, 6>::Zero();
    P.block<2, 2>(0, 0) = M;
    P.diagonal().tail<4>() << 5000, 6000, 7000.0 / 1000, 8800.0 / 1000;
    P.block<2, 2>(0, 2) = M * eps_1.asDiagonal();
    P.block<2, 2>(2, 0) = eps_1.asDiagonal() * M;
    P.block<2, 2>(0, 4) = -(M * eps_2.asDiagonal());
    P.block<2, 2>(4, 0) = -(eps_2.asDiagonal() * M);
    Eigen::Matrix<double, 6, 1> z;
    z << x.v - r.v_ref, x.q - r.q_ref, x.controller.value[1];
    const double expected = 0.5 * z.dot(P * z);
    EXPECT_NEAR(V(x, r), expected, 1e-13 * (P.norm() * z.squaredNorm()));  // rounding
    // Its weights are certified: V is positive definite.
    EXPECT_GT(numerics::smallest_eigenvalue(P), 0);
  }
}

TEST(Lyapunov, IsZeroOnTheReference) {
  Random random;
  for (const char* file : {"paper_rigid.yaml", "paper_flexible.yaml", "flexible_regulation.yaml"}) {
    const scenario::Scenario experiment = scenario(file);
    const auto V = controller::lyapunov_function(experiment);
    ASSERT_TRUE(V);
    messages::ReferencePoint r = random.reference(2);
    if (controller::law_facts(experiment.controller.law).regulation_only) {
      for (Vector* derivative : {&r.v_ref, &r.a_ref, &r.jerk_ref, &r.snap_ref}) {
        derivative->setZero();
      }
    }
    LoopState x{r.q_ref, r.v_ref, {}, {}, {}};
    x.controller.num = 4;
    x.controller.value = {Vector::Zero(2), Vector::Zero(2), Vector::Zero(2), Vector::Zero(2)};
    if (experiment.robot.flexible) {
      // theta_ref = q_ref + K^-1 ID(q_ref, v_ref, a_ref) and its derivative by central differences
      // along the reference's own Taylor series.
      const auto robot = controller::flexible_robot(experiment);
      const auto theta_ref = [&](double t) -> Vector {
        const Vector q = r.q_ref + t * r.v_ref + t * t / 2 * r.a_ref;
        const Vector v = r.v_ref + t * r.a_ref + t * t / 2 * r.jerk_ref;
        const Vector a = r.a_ref + t * r.jerk_ref + t * t / 2 * r.snap_ref;
        return q + robot::inverse_dynamics(robot.links, q, v, a).cwiseQuotient(robot.stiffness);
      };
      x.theta = theta_ref(0);
      x.thetadot = (theta_ref(1e-4) - theta_ref(-1e-4)) / 2e-4;
    }
    // Central differences: error h^2/6 of third derivatives of some 1e3, squared with J = 0.1.
    EXPECT_NEAR(V(x, r), 0, 1e-9) << file;
  }
}

/// V at each tick of the scenario's run.
std::vector<double> along(const scenario::Scenario& experiment,
                          const controller::LyapunovFunction& V) {
  std::vector<double> values;
  in_process::run_in_process(experiment, [&](const in_process::TickRecord& record) {
    values.push_back(V({record.truth.q, record.truth.v, record.truth.theta, record.truth.thetadot,
                        record.controller},
                       record.reference));
    return true;
  });
  return values;
}

/// From every `stride`th of the first ticks to the next.
void expect_fall(const scenario::Scenario& experiment, std::size_t ticks, std::size_t stride) {
  SCOPED_TRACE(experiment.name + ", " + experiment.controller.law);
  const auto V = controller::lyapunov_function(experiment);
  ASSERT_TRUE(V);
  const std::vector<double> values = along(experiment, V);
  ASSERT_GE(values.size(), ticks);
  for (std::size_t k = stride; k < ticks; k += stride) {
    EXPECT_LT(values[k], values[k - stride]) << "tick " << k;
    EXPECT_GT(values[k], 0);
  }
}

TEST(Lyapunov, FallsAlongThePapersLoop) {
  for (const char* file : {"paper_rigid_offset.yaml", "paper_flexible.yaml"}) {
    const scenario::Scenario experiment = scenario(file, {"loop.duration_s=0.05"});
    const auto ticks = static_cast<std::size_t>(experiment.loop.num_ticks);
    expect_fall(experiment, ticks, ticks / 10);
  }
}

TEST(Lyapunov, OfOtherLawsFalls) {
  const scenario::Scenario kelly = scenario("flexible_regulation.yaml", {"loop.duration_s=0.5"});
  EXPECT_FALSE(certified_run(kelly));
  expect_fall(kelly, static_cast<std::size_t>(kelly.loop.num_ticks), 100);
  const auto with = [](const std::string& file, std::vector<std::string> set) {
    set.insert(set.end(), {"plant.initial.position_rad=[0.2, -0.3]", "loop.duration_s=0.5",
                           "controller.feedforward_lead=none"});
    return scenario(file, set);
  };
  for (const scenario::Scenario& experiment :
       {with("practical_rigid.yaml",
             {"controller.law=wen_bayard", "controller.gains={kp: [40000, 2400], kd: [1000, 60]}"}),
        with("practical_rigid.yaml",
             {"controller.law=slotine_li", "controller.gains={lambda: [20, 30], ks: [50, 5]}"}),
        with("practical_flexible.yaml",
             {"controller.law=slotine_li_flexible",
              "controller.gains={lambda: [20, 30], ks1: [80, 20], ks2: [12, 16]}"})}) {
    EXPECT_FALSE(certified_run(experiment));
    // While it is far from what sampling at 1 ms leaves: the first tenth of a second.
    expect_fall(experiment, 101, 10);
  }
}

TEST(Lyapunov, StaysBelowItsCertifiedBound) {
  // The bound is of continuous time: these periods change V by less than 1e-3 of its first value.
  const std::vector<std::string> near = {
      "loop.duration_s=0.2", "loop.period_s=2e-5", "loop.command_delay=0",
      "plant.initial.position_rad=[0.003, -0.002]", "controller.feedforward_lead=none"};
  for (const char* file : {"paper_rigid.yaml", "practical_rigid.yaml", "practical_flexible.yaml"}) {
    const scenario::Scenario experiment = scenario(file, near);
    const auto certified = certified_run(experiment);
    ASSERT_TRUE(certified) << file;
    EXPECT_TRUE(certified->proved) << file;
    ASSERT_GT(certified->rate, 0) << file;
    EXPECT_LE(certified->V0, certified->level) << file;
    const auto V = controller::lyapunov_function(experiment, certified->weights);
    ASSERT_TRUE(V) << file;
    const std::vector<double> values = along(experiment, V);
    EXPECT_NEAR(values.front(), certified->V0, 1e-12 * certified->V0) << file;
    int above = 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
      const double t_s = static_cast<double>(k) * experiment.loop.period_s;
      if (values[k] > certified->bound(t_s) + 1e-3 * certified->V0) ++above;
    }
    EXPECT_EQ(above, 0) << file;
  }
}

TEST(Lyapunov, HasNoBoundFromWhereNothingIsCertified) {
  const auto far =
      certified_run(scenario("practical_rigid.yaml", {"plant.initial.position_rad=[50, -50]"}));
  ASSERT_TRUE(far);
  EXPECT_GT(far->V0, far->level);
  EXPECT_LT(far->rate, 0);
  EXPECT_EQ(far->bound(1), INFINITY);
}

TEST(Lyapunov, OfAConstantReferenceHasNoCrossTermsAndDoesNotRise) {
  const auto held = certified_run(scenario("regulation.yaml"));
  ASSERT_TRUE(held);
  EXPECT_TRUE(held->weights.eps_1.isZero(0));
  EXPECT_TRUE(held->weights.eps_2.isZero(0));
  EXPECT_EQ(held->rate, 0);
  EXPECT_EQ(held->bound(10), held->V0);
}

// A search over more joints would hold up the report for minutes; a constant reference needs none.
TEST(CertifiedRun, IsSearchedUpToItsMostJoints) {
  const int n = most_joints_of_certified_run + 1;
  const std::string urdf = robot::testing::chain_urdf(n);
  scenario::Scenario chain = scenario::parse_scenario(
      scenario::urdf_scenario(robot::model_from_urdf(urdf, "chain"), {"chain", "chain.urdf"}), urdf,
      "chain");
  ASSERT_EQ(chain.num_joints, n);
  ASSERT_EQ(chain.controller.law, "loria_ortega_rigid");
  ASSERT_GT(reference::make_trajectory(chain).at(0.3).v_ref.norm(), 0);
  EXPECT_FALSE(certified_run(chain));
}

}  // namespace
}  // namespace tachless::lyapunov
