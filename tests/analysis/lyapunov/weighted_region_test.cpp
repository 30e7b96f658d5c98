// The region of laws whose error equation is an ErrorForm: the identity of Vdot, the search of the
// weights, and runs from the boundary by the plants' equations of motion.
#include "lyapunov/weighted_region.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "base/parallel.h"
#include "certify/certify.h"
#include "controller/law/flexible_position.h"
#include "controller/law/loria_ortega_adaptive.h"
#include "numerics/decompositions.h"
#include "numerics/postures.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/controller/law/closed_loop.h"
#include "tests/core/robot/robots.h"

namespace tachless::lyapunov::weighted_region_test {
namespace {

using controller::law::FlexiblePosition;
using controller::law::LoriaOrtegaAdaptive;
using controller::law::Sine;
using controller::law::TwoLink;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Pair = Eigen::Vector2d;
using ::testing::HasSubstr;

const Sine reference{{0.5, 0.5}, 2};

/// Gains that are certified in continuous time; those of the scenario are for the sampled loop.
const std::vector<std::string> certifiable = {
    "controller.gains={kp1: [20000, 1200], kd1: [600, 30], a1: 500, b1: 500, beta: 1, kd2: [25, "
    "23], a2: 1000, b2: 1000}"};

std::optional<WeightedRegion> region(const std::string& name,
                                     const std::vector<std::string>& overrides) {
  std::string why_not;
  auto found = weighted_region(linear::testing::shipped(name, overrides), why_not);
  EXPECT_EQ(found.has_value(), why_not.empty());
  return found;
}

/// Returns the region with these gains, whose search takes seconds. It is found once.
const std::optional<WeightedRegion>& certifiable_region() {
  static const auto found = region("practical_flexible_positions", certifiable);
  return found;
}

TEST(ErrorForm, VdotIsTheQuadraticFormForAnyWeights) {
  for (const robot::Model& model :
       std::vector{robot::testing::two_link(), robot::testing::iiwa7()}) {
    const Eigen::Index n = model.num_joints, m = 3 * n;
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    const auto draw = [&](Eigen::Index rows, Eigen::Index columns) {
      return MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); }).eval();
    };
    for (int k = 0; k < 200; ++k) {
      const Vector q = draw(n, 1), v_ref = draw(n, 1), edot = draw(n, 1), v = v_ref + edot;
      const VectorXd y = draw(m, 1), D = draw(n, 1).cwiseAbs();
      const numerics::Inertia inertia = numerics::inertia_at(model, q);
      const MatrixXd Cd = robot::coriolis_matrix(model, q, v_ref);
      const ErrorForm form{draw(m, m), draw(m, n), draw(n, m), inertia.M, Cd, D, inertia.C};
      const MatrixXd any = draw(m, m);
      const FormWeights weights{any + any.transpose(), draw(n, m)};
      const MatrixXd C = robot::coriolis_matrix(model, q, v), Mdot = C + C.transpose();
      const VectorXd torque = form.Gam * y - C * edot - Cd * edot - D.cwiseProduct(edot);
      const VectorXd ydot = form.Fy * y + form.Fe * edot, delta = weights.N * y;
      const double Vdot = edot.dot(torque) + 0.5 * edot.dot(Mdot * edot) + y.dot(weights.P * ydot) +
                          (weights.N * ydot).dot(inertia.M * edot) +
                          delta.dot(Mdot * edot + torque);
      VectorXd x(m + n);
      x << y, edot;
      const MatrixXd Mm = decrease_matrix(form, weights);
      const double by_form =
          -x.dot(Mm * x) + edot.dot(robot::coriolis_product(model, q, Vector(delta), edot));
      ASSERT_NEAR(Vdot, by_form, 1e-12 * (1 + x.squaredNorm() * Mm.norm()));
    }
  }
}

/// Runs from random states of V = level, in parallel; each must fall at every step.
template <class State>
void expect_descents(std::size_t runs, int steps, double dt, double level,
                     const std::function<State(std::mt19937_64&)>& direction,
                     const std::function<State(double, const State&)>& rate,
                     const std::function<double(double, const State&)>& V,
                     const std::function<State(const State&)>& state_of) {
  std::vector<std::string> wrong(runs);
  base::parallel_for(runs, [&](std::size_t i) {
    std::mt19937_64 random(i);
    const State d = direction(random);
    double low = 0, high = 100;
    for (int k = 0; k < 60; ++k) {
      const double middle = (low + high) / 2;
      (V(0, state_of(middle * d)) < level ? low : high) = middle;
    }
    State x = state_of(low * d);
    double before = V(0, x);
    if (std::abs(before - level) > 1e-6 * level) wrong[i] = "does not begin on the boundary";
    for (int k = 0; k < steps && wrong[i].empty(); ++k) {
      x = controller::law::runge_kutta_4(rate, k * dt, x, dt);
      const double now = V((k + 1) * dt, x);
      if (!(now <= before + 1e-10 * level)) wrong[i] = "rises at step " + std::to_string(k);
      before = now;
    }
  });
  for (const std::string& run : wrong) EXPECT_EQ(run, "");
}

/// The two-link arm with springs under flexible_position in continuous time: x = (q, theta, v,
/// thetadot, nu1, nu2).
struct PositionArm {
  using State = Eigen::Matrix<double, 12, 1>;

  const Pair kp1{20000, 1200}, kd1{600, 30}, kd2{25, 23}, J{0.1, 0.1};
  const double K = 1e4, a1 = 500, a2 = 1000;
  Sine motion = reference;
  Pair D_s{0, 0};  ///< damping of the springs [N m s/rad]
  const TwoLink<double> arm{};
  const FlexiblePosition law{
      {robot::testing::two_link(), controller::law::vector(K, K),
       controller::law::vector(0.1, 0.1)},
      {kp1, kd1, Pair(a1, a1), Pair(a1, a1), Pair(1, 1), kd2, Pair(a2, a2), Pair(a2, a2)},
      {}};

  [[nodiscard]] Pair t1(const messages::ReferencePoint& r, const State& x) const {
    const Pair q = x.head<2>(), nu1 = x.segment<2>(8);
    return arm.torque(q, r.v_ref, r.v_ref, r.a_ref) - kp1.cwiseProduct(q - Pair(r.q_ref)) -
           kd1.cwiseProduct(nu1);
  }
  [[nodiscard]] State rate(double t, const State& x) const {
    const messages::ReferencePoint r = motion.at(t);
    const robot::JetVector theta_d = law.motor_reference(r);
    const Pair q = x.head<2>(), theta = x.segment<2>(2), v = x.segment<2>(4);
    const Pair thetadot = x.segment<2>(6), nu1 = x.segment<2>(8), nu2 = x.segment<2>(10);
    const Pair tau =
        t1(r, x) + J.cwiseProduct(Pair(robot::second_derivative(theta_d))) - kd2.cwiseProduct(nu2);
    const Pair spring = K * (theta - q) + D_s.cwiseProduct(thetadot - v);
    State dot;
    dot << v, thetadot, arm.acceleration(q, v, spring), (tau - spring).cwiseQuotient(J),
        a1 * (v - Pair(r.v_ref) - nu1),
        a2 * (thetadot - Pair(robot::first_derivative(theta_d)) - nu2);
    return dot;
  }
  [[nodiscard]] double V(double t, const State& x, const FormWeights& weights) const {
    const messages::ReferencePoint r = motion.at(t);
    const robot::JetVector theta_d = law.motor_reference(r);
    const Pair q = x.head<2>(), edot = x.segment<2>(4) - Pair(r.v_ref);
    VectorXd y(10);
    y << q - Pair(r.q_ref), x.segment<2>(8), K * (x.segment<2>(2) - q) - t1(r, x),
        x.segment<2>(6) - Pair(robot::first_derivative(theta_d)), x.segment<2>(10);
    const Pair p = arm.M(q) * edot;
    return 0.5 * edot.dot(p) + 0.5 * y.dot(weights.P * y) + Pair(weights.N * y).dot(p);
  }
  /// Returns errors (e1, edot, z, w, nu1, nu2) of sizes with which each part counts.
  static State direction(std::mt19937_64& random) {
    std::normal_distribution<double> normal;
    State d;
    for (int i = 0; i < 12; ++i) d[i] = normal(random);
    return d.cwiseProduct(
        (State() << 1, 4, 50, 200, 1e4, 1e4, 300, 300, 30, 100, 300, 300).finished());
  }
  /// Returns the state of errors (e1, edot, z, w, nu1, nu2) at t = 0.
  [[nodiscard]] State state_of(const State& errors) const {
    const messages::ReferencePoint r = motion.at(0);
    const robot::JetVector theta_d = law.motor_reference(r);
    State x = State::Zero();
    x.head<2>() = Pair(r.q_ref) + errors.head<2>();
    x.segment<2>(4) = Pair(r.v_ref) + errors.segment<2>(2);
    x.segment<2>(6) = Pair(robot::first_derivative(theta_d)) + errors.segment<2>(6);
    x.segment<2>(8) = errors.segment<2>(8);
    x.segment<2>(10) = errors.segment<2>(10);
    x.segment<2>(2) = x.head<2>() + (t1(r, x) + errors.segment<2>(4)) / K;
    return x;
  }
};

/// By another program, which searched rho at fixed levels: 2.85 and 9.81 rad.
TEST(WeightedRegion, OfFlexiblePositionHoldsLargeDisplacementsAndVNeverRisesFromItsBoundary) {
  const auto& found = certifiable_region();
  ASSERT_TRUE(found);
  EXPECT_GE(found->e_at_rest[0], 2.85);
  EXPECT_GE(found->e_at_rest[1], 9.8);
  EXPECT_TRUE(found->holds_initial_state());
  EXPECT_GE(found->forms, 400);
  EXPECT_TRUE(found->proved);
  const PositionArm loop;
  using State = PositionArm::State;
  expect_descents<State>(
      1000, 1000, 5e-5, found->region.level, PositionArm::direction,
      [&](double t, const State& x) { return loop.rate(t, x); },
      [&](double t, const State& x) { return loop.V(t, x, found->weights); },
      [&](const State& errors) { return loop.state_of(errors); });
}

/// The region that is proved is inside of what any other postures and instants give.
TEST(WeightedRegion, IsProvedWithinTheRegionOfOtherPostures) {
  const scenario::Scenario scenario =
      linear::testing::shipped("practical_flexible_positions", certifiable);
  std::string why_not;
  const auto& found = certifiable_region();
  const auto loop = form_loop(scenario, why_not);
  ASSERT_TRUE(found && found->proved && loop);
  std::vector<ErrorForm> others;
  for (int k = 0; k < 1000; ++k) others.push_back(loop->form(1000 + k));
  const FormRegion sampled = region_of(others, found->weights);
  EXPECT_GE(sampled.level, found->region.level);
  EXPECT_GE(sampled.rate, found->region.rate);
  EXPECT_GE(found->region.level, 0.8 * sampled.level) << "the proof gives little away";
}

TEST(TorqueGradients, AreBoundedAtEveryPosture) {
  const robot::Model model = robot::testing::two_link();
  const Vector v = Pair(1, 2), a = Pair(3, 1), jerk = Pair(5, 20), none = Vector::Zero(2);
  const TorqueGradients most = torque_gradients(model, v, a, jerk).value();
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> share(-1, 1);
  const auto within = [&](const Vector& x) {
    return Vector(Pair(share(random) * x[0], share(random) * x[1]));
  };
  MatrixXd of_torque = MatrixXd::Zero(2, 2), of_rate = of_torque;
  for (int k = 0; k < 20000; ++k) {
    const Vector q = within(Pair(4, 4)), v_ref = within(v), a_ref = within(a), j = within(jerk);
    const auto torque = [&](const Vector& at) {
      return robot::inverse_dynamics(model, robot::jet(at, v_ref, none),
                                     robot::jet(v_ref, a_ref, none), robot::jet(a_ref, j, none));
    };
    constexpr double step = 1e-5;  // errors of 1e-9 of the gradients, of 20 N m/rad and more
    for (int i = 0; i < 2; ++i) {
      const Vector d = step * Vector::Unit(2, i);
      const auto ahead = torque(q + d), behind = torque(q - d);
      const Vector first = robot::value(ahead) - robot::value(behind);
      const Vector second = robot::first_derivative(ahead) - robot::first_derivative(behind);
      of_torque.col(i) = of_torque.col(i).cwiseMax(first.cwiseAbs() / (2 * step));
      of_rate.col(i) = of_rate.col(i).cwiseMax(second.cwiseAbs() / (2 * step));
    }
  }
  EXPECT_TRUE((of_torque.array() < most.of_torque.array() + 1e-6).all()) << of_torque;
  EXPECT_TRUE((of_rate.array() < most.of_rate.array() + 1e-6).all()) << of_rate;
  EXPECT_GT(of_torque(0, 0), 0.9 * most.of_torque(0, 0));
}

/// Gains that are fast in the sampled loop are certified too, with a smaller region.
TEST(WeightedRegion, OfFlexiblePositionContainsTheShippedScenario) {
  const auto found = region("practical_flexible_positions", {"plant.payload={mass_kg: 0.5}"});
  ASSERT_TRUE(found);
  EXPECT_GE(found->e_at_rest[0], 0.7);
  EXPECT_GE(found->e_at_rest[1], 3.5);
  EXPECT_TRUE(found->holds_initial_state());
  ASSERT_EQ(found->provisos.size(), 1U);
  EXPECT_THAT(found->provisos[0], HasSubstr("the payload of 0.5 kg is not in it"));
}

/// At a constant reference the dampers of the springs are in the region in full. It holds starts at
/// thousands of rad/s, so that the steps are short.
TEST(WeightedRegion, OfFlexiblePositionCountsTheDampingOfTheSprings) {
  std::vector<std::string> damped = certifiable;
  damped.emplace_back("reference={hold: {position_rad: [0, 0]}}");
  damped.emplace_back("robot.joints.flexible.spring_damping_Nms_per_rad=[40, 20]");
  const auto found = region("practical_flexible_positions", damped);
  ASSERT_TRUE(found);
  EXPECT_THAT(found->provisos, ::testing::IsEmpty());
  PositionArm loop;
  loop.motion = {{0, 0}, 0};
  loop.D_s = {40, 20};
  using State = PositionArm::State;
  expect_descents<State>(
      100, 500, 1e-5, found->region.level, PositionArm::direction,
      [&](double t, const State& x) { return loop.rate(t, x); },
      [&](double t, const State& x) { return loop.V(t, x, found->weights); },
      [&](const State& errors) { return loop.state_of(errors); });
  damped[1] = "loop.duration_s=5";  // and the reference moves
  EXPECT_THAT(
      lyapunov::provisos(linear::testing::shipped("practical_flexible_positions", damped), false),
      ::testing::ElementsAre(HasSubstr("the torque on the reference")));
}

TEST(WeightedRegion, OfFlexiblePositionHasNoneWhereTheTorqueLoopIsTooSlow) {
  EXPECT_FALSE(region("practical_flexible_positions", {"controller.gains.kd1=[6000, 300]"}));
}

/// By another program: 4.8 and 12.6 rad.
TEST(WeightedRegion, OfFlexibleMotor) {
  const auto found = region(
      "practical_flexible",
      {"controller.law=flexible_motor",
       "controller.gains={kp: [1000, 100], kd: [57, 12], a: 980, b: 980}",
       "robot.joints={flexible: {stiffness_Nm_per_rad: [10000, 10000], rotor_inertia_kgm2: [0.1, "
       "0.1]}}",
       "reference={sinusoid: {amplitude_rad: [0.5, 0.5], frequency_hz: [0.3183098861837907, "
       "0.3183098861837907]}}"});
  ASSERT_TRUE(found);
  EXPECT_TRUE(found->proved);
  EXPECT_GT(found->e_at_rest[0], 4.8);
  EXPECT_GT(found->e_at_rest[1], 12.6);
}

/// The two-link arm with an unknown mass at its tip, in continuous time: x = (q, v, nu, mass).
struct AdaptiveArm {
  using State = Eigen::Matrix<double, 7, 1>;

  double mass = 0.5, most = 0.5, gamma = 5;
  const Pair kp{4000, 400}, kd{300, 30};
  const double a = 300, eps_1 = 6, eps_2 = 0.1;
  const LoriaOrtegaAdaptive law{robot::testing::two_link(), gains(), {}};

  [[nodiscard]] LoriaOrtegaAdaptive::Gains gains() const {
    LoriaOrtegaAdaptive::Gains g{kp, kd, Pair(a, a), Pair(a, a), eps_1, eps_2};
    g.gamma_mass = gamma;
    g.mass_max = most;
    return g;
  }
  [[nodiscard]] Pair delta(const Pair& e, const Pair& nu) const { return eps_1 * e - eps_2 * nu; }
  [[nodiscard]] State rate(double t, const State& x) const {
    const TwoLink<double> nominal, loaded{mass};
    const messages::ReferencePoint r = reference.at(t);
    const Pair q = x.head<2>(), v = x.segment<2>(2), nu = x.segment<2>(4);
    const Pair e = q - Pair(r.q_ref), edot = v - Pair(r.v_ref);
    const Pair Y = law.columns_at(r, {r.v_ref, r.a_ref}).col(0);
    const Pair tau = nominal.torque(q, r.v_ref, r.v_ref, r.a_ref) + x[6] * Y - kp.cwiseProduct(e) -
                     kd.cwiseProduct(nu);
    double estimate = -gamma * Y.dot(edot + delta(e, nu));
    if (x[6] <= 0) estimate = std::max(estimate, 0.0);
    if (x[6] >= most) estimate = std::min(estimate, 0.0);
    State dot;
    dot << v, loaded.acceleration(q, v, tau), a * (edot - nu), estimate;
    return dot;
  }
  [[nodiscard]] double V(double t, const State& x) const {
    const TwoLink<double> loaded{mass};
    const messages::ReferencePoint r = reference.at(t);
    const Pair e = x.head<2>() - Pair(r.q_ref), edot = x.segment<2>(2) - Pair(r.v_ref);
    const Pair nu = x.segment<2>(4), p = loaded.M(x.head<2>()) * edot;
    return 0.5 * (edot.dot(p) + e.dot(kp.cwiseProduct(e)) + nu.dot(kd.cwiseProduct(nu)) / a) +
           delta(e, nu).dot(p) + 0.5 * (x[6] - mass) * (x[6] - mass) / gamma;
  }
};

const std::vector<std::string> half_a_kilogram = {
    "reference={sinusoid: {amplitude_rad: [0.5, 0.5], frequency_hz: [0.3183098861837907, "
    "0.3183098861837907]}}",
    "controller.gains.mass_max=0.5"};

std::vector<std::string> with(std::vector<std::string> all, const std::string& more) {
  all.push_back(more);
  return all;
}

/// By another program with H at the posture of M: 9116 J, and for 1 kg 1084 J.
TEST(WeightedRegion, OfTheAdaptiveLawHoldsForEveryMassOfTheBox) {
  const auto half = region("practical_adaptive", half_a_kilogram);
  const auto one =
      region("practical_adaptive", with(half_a_kilogram, "controller.gains.mass_max=1"));
  ASSERT_TRUE(half && one);
  EXPECT_GT(half->region.level, 5000);
  EXPECT_LT(half->region.level, 12000);
  EXPECT_LT(one->region.level, half->region.level / 3);
  EXPECT_DOUBLE_EQ(*half->of_parameters, 0.5 * 0.5 * 0.5 / 5);
  EXPECT_TRUE(half->holds_initial_state());
  for (const double mass : {0.5, 0.2}) {
    AdaptiveArm loop;
    loop.mass = mass;
    using State = AdaptiveArm::State;
    expect_descents<State>(
        200, 4000, 5e-5, half->region.level,
        [](std::mt19937_64& random) {
          std::normal_distribution<double> normal;
          State d;
          for (int i = 0; i < 7; ++i) d[i] = normal(random);
          return State(d.cwiseProduct((State() << 1, 3, 30, 100, 20, 60, 0).finished()));
        },
        [&](double t, const State& x) { return loop.rate(t, x); },
        [&](double t, const State& x) { return loop.V(t, x); },
        [&](const State& errors) {
          const messages::ReferencePoint r = reference.at(0);
          State x = errors;
          x.head<2>() += Pair(r.q_ref);
          x.segment<2>(2) += Pair(r.v_ref);
          return x;
        });
  }
}

TEST(WeightedRegion, OfTheAdaptiveLawHasNoneWithWeightsThatTheBoxForbids) {
  const auto bold = with(half_a_kilogram, "controller.gains.eps_1=10");
  EXPECT_FALSE(region("practical_adaptive", with(bold, "controller.gains.eps_2=0.15")));
  // Without a load the same weights are certified.
  EXPECT_TRUE(region("practical_adaptive", with(with(bold, "controller.gains.eps_2=0.15"),
                                                "controller.gains.mass_max=0.001")));
}

/// The payload of 0.5 kg sits in the frame of the last link.
TEST(WeightedRegion, SaysWhereThePayloadIsOutsideOfTheBox) {
  const auto said = [](const std::string& change) {
    return lyapunov::provisos(linear::testing::shipped("practical_adaptive", {change}), false);
  };
  const auto outside = ::testing::Contains(
      HasSubstr("the payload of 0.5 kg is not in it: it is outside of the box"));
  EXPECT_THAT(said("controller.gains.mass_max=0.5"), ::testing::IsEmpty());
  EXPECT_THAT(said("controller.gains.mass_max=0.4"), outside);
  EXPECT_THAT(said("plant.payload.center_of_mass_m=[0.1, 0, 0]"), outside);
  EXPECT_THAT(said("plant.payload.inertia_kgm2=[0.01, 0, 0, 0.01, 0, 0.01]"), outside);
}

TEST(WeightedRegion, IsPrintedByCertify) {
  const scenario::Scenario scenario =
      linear::testing::shipped("practical_adaptive", half_a_kilogram);
  const certify::Certificate found = certify::certify(scenario);
  const std::string page = certify::page(found, scenario, false);
  EXPECT_THAT(page, HasSubstr("at sampled postures, in continuous time: this start is in it"));
  EXPECT_THAT(page, HasSubstr("the unknown parameters take at most"));
  const auto json = certify::to_json(found)["region"];
  EXPECT_EQ(json["status"], "sampled");
  EXPECT_TRUE(json["start"]["certified"].get<bool>());
  EXPECT_GT(json["largest"]["level"].get<double>(), 5000);
}

}  // namespace
}  // namespace tachless::lyapunov::weighted_region_test
