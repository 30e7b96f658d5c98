// The laws derived here from the paper's: V's derivative is the quadratic form, and what follows.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <complex>
#include <random>

#include "base/parallel.h"
#include "certify/certify.h"
#include "controller/law/loria_ortega_scheduled.h"
#include "in_process/in_process_loop.h"
#include "lyapunov/law_loop.h"
#include "reference/make_trajectory.h"
#include "tests/analysis/linear/loops.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/analysis/lyapunov/decrease.h"
#include "tests/controller/law/closed_loop.h"

namespace tachless::lyapunov {
namespace {

using namespace linear;
using namespace linear::testing;
using namespace lyapunov::testing;
using controller::law::Sine;
using controller::law::TwoLink;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Pair = Eigen::Vector2d;

// ---- with an integral -------------------------------------------------------------------------

/// The continuous loop of loria_ortega_integral on the two-link arm, with a constant unknown torque
/// d: the state is (q, v, nu, z), z = Ki y - d.
struct IntegralLoop {
  FilterGains gains = practical_rigid();
  Pair ki{10000, 600};
  Weights weights = Weights(28, 0.14).of(2);
  Sine reference{{0.1 / M_PI, 0.1 / M_PI}, 10 * M_PI};

  using State = Eigen::Matrix<double, 8, 1>;

  [[nodiscard]] Pair delta(const Pair& e, const Pair& nu) const {
    return weights.eps_1.cwiseProduct(e) - weights.eps_2.cwiseProduct(nu);
  }

  [[nodiscard]] State rate(double t, const State& x) const {
    const TwoLink<double> arm;
    const messages::ReferencePoint r = reference.at(t);
    const Pair q = x.head<2>(), v = x.segment<2>(2), nu = x.segment<2>(4), z = x.tail<2>();
    const Pair e = q - Pair(r.q_ref), edot = v - Pair(r.v_ref);
    const Pair tau = arm.torque(q, r.v_ref, r.v_ref, r.a_ref) - gains.kp.cwiseProduct(e) -
                     gains.kd.cwiseProduct(nu) - z;  // d less what the integral commands
    State dot;
    dot << v, arm.acceleration(q, v, tau), gains.b.cwiseProduct(edot) - gains.a.cwiseProduct(nu),
        ki.cwiseProduct(edot + delta(e, nu));
    return dot;
  }

  /// V + 1/2 z' Ki^-1 z. Without `dot`, whose product would conjugate.
  template <class Scalar>
  [[nodiscard]] Scalar V(const Eigen::Matrix<Scalar, 8, 1>& x,
                         const Eigen::Matrix<Scalar, 4, 1>& ref) const {
    const Eigen::Matrix<Scalar, 2, 1> q = x.template head<2>(), nu = x.template segment<2>(4),
                                      z = x.template tail<2>();
    const Eigen::Matrix<Scalar, 2, 1> e = q - ref.template head<2>(),
                                      edot = x.template segment<2>(2) - ref.template tail<2>();
    // TwoLink's M, which divides by whole numbers.
    const Scalar c = 0.51 * std::cos(q[1]);
    const Eigen::Matrix<Scalar, 2, 1> p((8.77 + 2.0 * c) * edot[0] + (0.76 + c) * edot[1],
                                        (0.76 + c) * edot[0] + 0.62 * edot[1]);
    Scalar sum = 0;
    for (int i = 0; i < 2; ++i) {
      sum += edot[i] * p[i] / 2.0 + gains.kp[i] * e[i] * e[i] / 2.0 +
             gains.kd[i] / gains.b[i] * nu[i] * nu[i] / 2.0 +
             (weights.eps_1[i] * e[i] - weights.eps_2[i] * nu[i]) * p[i] +
             z[i] * z[i] / ki[i] / 2.0;
    }
    return sum;
  }
  [[nodiscard]] double V_at(double t, const State& x) const {
    Eigen::Vector4d ref;
    ref << reference.at(t).q_ref, reference.at(t).v_ref;
    return V<double>(x, ref);
  }
  /// By a complex step along the motion, exact to rounding.
  [[nodiscard]] double Vdot(double t, const State& x) const {
    using C = std::complex<double>;
    constexpr double step = 1e-30;
    const messages::ReferencePoint r = reference.at(t);
    Eigen::Vector4d ref, ref_dot;
    ref << r.q_ref, r.v_ref;
    ref_dot << r.v_ref, r.a_ref;
    const C i(0, step);
    return V<C>(x.cast<C>() + i * rate(t, x).cast<C>(), ref.cast<C>() + i * ref_dot.cast<C>())
               .imag() /
           step;
  }
};

TEST(IntegralLaw, VdotIsTheQuadraticFormWhateverTheUnknownTorque) {
  const IntegralLoop loop;
  const ErrorSystem system = linear::testing::rigid(loop.gains);
  const robot::Model model = robot::testing::two_link();
  robot::testing::Random random(1);
  for (int k = 0; k < 1000; ++k) {
    const double t = random.uniform(0, 1);
    IntegralLoop::State x;
    for (int i = 0; i < 8; ++i) x[i] = random.uniform(-1, 1) * (i < 2 ? 3 : i < 6 ? 20 : 300);
    const messages::ReferencePoint r = loop.reference.at(t);
    VectorXd z(6);
    z << x.head<2>() - Pair(r.q_ref), x.segment<2>(4), x.segment<2>(2) - Pair(r.v_ref);
    const VectorXd delta = loop.delta(z.head(2), z.segment(2, 2));
    const MatrixXd Mm = decrease_matrix(
        system, loop.weights, numerics::inertia_at(model, x.head<2>()), VectorXd(r.v_ref), delta);
    // Rounding of terms of the size of z's power and of the largest in the form.
    ASSERT_NEAR(loop.Vdot(t, x), -z.dot(Mm * z), 1e-11 * (1e4 + z.squaredNorm() * Mm.norm()));
  }
}

/// Expects that V falls at every step of runs from random states of that level, and to 5 % of it.
void expect_descents(const IntegralLoop& loop, double level, std::size_t runs, double dt,
                     int steps) {
  std::vector<std::string> wrong(runs);
  base::parallel_for(wrong.size(), [&](std::size_t i) {
    std::mt19937_64 random(i);
    std::normal_distribution<double> normal;
    IntegralLoop::State x = IntegralLoop::State::Zero();
    const Pair along[] = {{normal(random), normal(random)},
                          {30 * normal(random), 30 * normal(random)},
                          {300 * normal(random), 100 * normal(random)}};
    x << along[0], along[1], Pair::Zero(), loop.ki.isZero(1e-6) ? Pair::Zero() : along[2];
    const messages::ReferencePoint r = loop.reference.at(0);
    IntegralLoop::State on = IntegralLoop::State::Zero();
    on << r.q_ref, r.v_ref, Pair::Zero(), Pair::Zero();
    // V is a quadratic form of what is beside the reference, but for M(q).
    double low = 0, high = 1000;
    for (int k = 0; k < 60; ++k) {
      const double middle = (low + high) / 2;
      (loop.V_at(0, on + middle * x) < level ? low : high) = middle;
    }
    x = on + low * x;
    double before = loop.V_at(0, x);
    const double V0 = before;
    for (int k = 0; k < steps; ++k) {
      x = controller::law::runge_kutta_4(
          [&](double t, const IntegralLoop::State& y) -> IntegralLoop::State {
            return loop.rate(t, y);
          },
          k* dt, x, dt);
      const double V = loop.V_at((k + 1) * dt, x);
      if (V > before + 1e-12 * V0) wrong[i] = "rises at step " + std::to_string(k);
      before = V;
    }
    if (before > 5e-2 * V0) wrong[i] += " stays at " + std::to_string(before / V0);
  });
  for (const std::string& run : wrong) EXPECT_EQ(run, "");
}

MatrixCondition two_link_condition(const IntegralLoop& loop,
                                   const numerics::PostureOptions& of = {}) {
  return {{linear::testing::rigid(loop.gains)},
          numerics::Postures(robot::testing::two_link(), of),
          linear::testing::paper_B_d};
}

TEST(IntegralLaw, TotalVNeverRisesInAThousandRunsFromTheBoundaryOfTheRegion) {
  const IntegralLoop loop;
  const auto region = two_link_condition(loop).region(loop.weights);
  ASSERT_TRUE(region);
  expect_descents(loop, region->level, 1000, 5e-5, 4000);  // poles of 1000 1/s: 1e-7 a step
}

/// From tens of rad and a thousand rad/s, where sampling would break the loop first.
TEST(LargestRegion, VNeverRisesFromItsBoundary) {
  IntegralLoop loop;
  loop.ki.setConstant(1e-9);  // without an integral
  const auto found =
      best_weights(two_link_condition(loop, {.circle_points = 24, .bound_between = false}),
                   two_link_condition(loop), Goal::level);
  ASSERT_TRUE(found);
  EXPECT_GT(found->region.e_at_rest[1], 44);
  loop.weights = found->weights;
  expect_descents(loop, found->region.level, 200, 5e-6, 30000);
}

const std::vector<std::string> with_integral = {
    "controller.law=loria_ortega_integral", "controller.gains.ki=[10000, 600]",
    "controller.gains.eps_1=28", "controller.gains.eps_2=0.14"};

std::vector<std::string> operator+(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(IntegralLaw, IsCertifiedWithItsOwnWeightsAndSaysWhichTorquesItTakesUp) {
  const certify::Certificate found =
      certify::certify(linear::testing::shipped("practical_rigid", with_integral), false);
  ASSERT_TRUE(found.stability && found.stability->fastest);
  const CertifiedRegion& region = *found.stability->fastest;
  EXPECT_TRUE(found.stability->own_weights);
  EXPECT_FALSE(found.stability->largest);
  EXPECT_EQ(region.weights.eps_1[0], 28);
  EXPECT_TRUE(region.holds_initial_state());
  ASSERT_EQ(region.unknown_torque.size(), 2);
  EXPECT_NEAR(region.unknown_torque[0], std::sqrt(2 * 10000 * (region.region.level - region.V0)),
              1e-6);
  EXPECT_TRUE(found.loop.stable);
}

/// |e| of joint 1 over the last second of a run held at [0.5, 0.5].
std::pair<double, int> last_second(const std::vector<std::string>& overrides) {
  const scenario::Scenario scenario = linear::testing::shipped(
      "practical_rigid",
      overrides + std::vector<std::string>{"reference={hold: {position_rad: [0.5, 0.5]}}",
                                           "plant.initial.position_rad=[0.45, 0.5]",
                                           "loop.duration_s=6", "plant.mechanics=native"});
  double most = 0, last = 0;
  int crossings = 0;
  in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
    if (record.time_s < 3) return true;
    const double e = record.truth.q[0] - 0.5;
    if (e * last < 0) ++crossings;
    last = e;
    if (record.time_s >= 5) most = std::max(most, std::abs(e));
    return true;
  });
  return {most, crossings};
}

TEST(IntegralLaw, EndsWithinACountWhereTheErrorIsTheTorqueOverKpOtherwise) {
  const std::vector<std::string> pushed = {
      "plant.disturbances=[{joint: shoulder, torque_Nm: 40}, {joint: elbow, torque_Nm: -5}]"};
  const double count = 2 * M_PI / (1 << 20);
  EXPECT_LT(last_second(with_integral + pushed).first, count);
  // The drive of joint 1 rests at 40 N m of 40000 N m/rad, to a count.
  EXPECT_NEAR(last_second(pushed).first, 1e-3, count);
}

TEST(IntegralLaw, HuntsUnderStiction) {
  const auto held = [](const std::string& law, const std::string& more) {
    return last_second(
        {"plant.drive.coulomb_friction_Nm=[20, 2]", "plant.drive.static_friction_Nm=[40, 4]",
         "controller.law=" + law,
         "controller.gains={kp: [4000, 1500], kd: [300, 60], a: 300, b: 300" + more + "}"});
  };
  const auto [most, crossings] =
      held("loria_ortega_integral", ", ki: [10000, 3000], eps_1: 10, eps_2: 0.15");
  EXPECT_GE(crossings, 2) << "breaks away again and again";
  EXPECT_EQ(held("loria_ortega_rigid", "").second, 0) << "without it the joint sticks";
  RecordProperty("largest_error_1e-6_rad", static_cast<int>(most * 1e6));
  RecordProperty("crossings", crossings);
}

// ---- gains that follow the reference ----------------------------------------------------------

void expect_identity(const robot::Model& model, unsigned seed) {
  robot::testing::Random random(seed);
  const Eigen::Index n = model.num_joints;
  controller::law::Settings settings;
  settings.viscous = random.vector(n, 1).cwiseAbs();
  const controller::law::ScheduledGains g{23, 0.7, 300, 400};
  const controller::law::LoriaOrtegaScheduled law(model, g, settings);
  const Vector zero = Vector::Zero(n);
  for (int k = 0; k < 500; ++k) {
    const Weights w{VectorXd(15 * (random.vector(n, 1).array() + 1)),
                    VectorXd(0.05 * (random.vector(n, 1).array() + 1))};
    messages::ReferencePoint r = linear::constant_reference(random.vector(n, 3));
    r.v_ref = random.vector(n, 2);
    const ErrorSystem s = system_at(law, r, settings.viscous);
    const Vector q = random.vector(n, 3);
    const VectorXd e = random.vector(n, 1), nu = random.vector(n, 3), edot = random.vector(n, 2);
    const Vector v = r.v_ref + Vector(edot);
    // Jets of M at q and at q_ref; nothing is shared with the law's rates or with Mm.
    const auto part = [&](const Vector& at, const Vector& along, bool rate) {
      const auto jets = robot::mass_matrix(model, robot::jet(at, along, zero));
      return MatrixXd(MatrixXd::NullaryExpr(n, n, [&](Eigen::Index i, Eigen::Index j) {
        return rate ? jets(i, j).first : jets(i, j).value;
      }));
    };
    const MatrixXd M = part(q, v, false), Mdot = part(q, v, true);
    const MatrixXd at_ref = part(r.q_ref, r.v_ref, false), rate = part(r.q_ref, r.v_ref, true);
    const MatrixXd D = VectorXd(settings.viscous).asDiagonal();
    const MatrixXd Kp = g.w * g.w * at_ref + g.w * D, Kd = 2 * g.damping * g.w * at_ref;
    const MatrixXd C =
        robot::coriolis_matrix(model, q, v) + robot::coriolis_matrix(model, q, r.v_ref);
    const VectorXd M_eddot = -(C + D) * edot - Kp * e - Kd * nu;
    const VectorXd nudot = g.b * edot - g.a * nu;
    const VectorXd delta = w.eps_1.cwiseProduct(e) - w.eps_2.cwiseProduct(nu);
    const double terms[] = {
        edot.dot(M_eddot),
        edot.dot(Mdot * edot) / 2,
        e.dot(Kp * edot),
        g.w * g.w * e.dot(rate * e) / 2,
        nu.dot(Kd * nudot) / g.b,
        g.damping * g.w * nu.dot(rate * nu) / g.b,
        (w.eps_1.cwiseProduct(edot) - w.eps_2.cwiseProduct(nudot)).dot(M * edot),
        delta.dot(Mdot * edot),
        delta.dot(M_eddot)};
    double Vdot = 0, size = 0;
    for (const double term : terms) {
      Vdot += term;
      size += std::abs(term);
    }
    VectorXd z(3 * n);
    z << e, nu, edot;
    const MatrixXd Mm =
        decrease_matrix(s, w, numerics::inertia_at(model, q), VectorXd(r.v_ref), delta);
    ASSERT_NEAR(-z.dot(Mm * z), Vdot, 1e-12 * size);
  }
}

TEST(ScheduledLaw, VdotIsTheQuadraticFormForTwoJoints) {
  expect_identity(robot::testing::two_link(0.5), 1);
}
TEST(ScheduledLaw, VdotIsTheQuadraticFormForSevenJoints) {
  expect_identity(robot::testing::iiwa7(), 2);
}

/// w of 23 Hz at 1 kHz, a = 1 / h, as the rule has it.
const std::vector<std::string> scheduled = {
    "controller.law=loria_ortega_scheduled",
    "controller.gains={w: 145, damping: 0.7, a: 1000, b: 1000}", "plant.mechanics=native",
    "loop.period_s=1e-3", "loop.command_delay=1"};

class ScheduledArms : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Scenarios, ScheduledArms,
                         ::testing::Values("practical_rigid", "ur5e", "iiwa_point_to_point",
                                           "panda", "xarm7"),
                         [](const auto& arm) { return std::string(arm.param); });

TEST_P(ScheduledArms, SettleAsFastAsTheRuleSays) {
  const scenario::Scenario scenario = linear::testing::shipped(GetParam(), scheduled);
  const certify::Prediction found = certify::analyse(scenario, linear::Effort::full);
  EXPECT_TRUE(found.stable) << certify::text(found);
  EXPECT_LE(found.modes.settling_s, 0.16);
  ASSERT_TRUE(found.margins);
  EXPECT_GE(found.margins->modulus, 0.45);
  RecordProperty("settling_s", std::to_string(found.modes.settling_s));
  RecordProperty("modulus", std::to_string(found.margins->modulus));
}

TEST(ScheduledLaw, IsCertifiedAndItsRunFollows) {
  for (const auto* name : {"practical_rigid", "iiwa_point_to_point"}) {
    const scenario::Scenario scenario = linear::testing::shipped(name, scheduled);
    std::string why_not;
    const auto found = stability_certificate(scenario, linear::Effort::full, why_not);
    ASSERT_TRUE(found) << why_not;
    EXPECT_FALSE(found->proved) << "instants of the reference are sampled";
    ASSERT_TRUE(found->fastest) << name;
    EXPECT_GT(found->fastest->rate, 0);
    EXPECT_TRUE(found->fastest->holds_initial_state());
    double end = 0;
    in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
      end = (record.truth.q - record.reference.q_ref).cwiseAbs().maxCoeff();
      return true;
    });
    EXPECT_LT(end, 2e-4) << name;
  }
}

}  // namespace
}  // namespace tachless::lyapunov
