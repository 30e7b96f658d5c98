#include "controller/law/loria_ortega_adaptive.h"

#include "controller/law/loria_ortega_rigid.h"
#include "tests/controller/law/first_order.h"
#include "tests/core/robot/robots.h"

namespace tachless::controller::law::loria_ortega_adaptive_test {
namespace {

AdaptiveGains example() {
  AdaptiveGains gains{
      vector(4000, 400), vector(300, 30), vector(300, 300), vector(300, 300), 6, 0.1};
  gains.gamma_mass = 5;
  gains.mass_max = 3;
  gains.gamma_friction = vector(400, 60);
  gains.friction_max = vector(20, 5);
  return gains;
}

/// Returns the columns' product with a load's parameters and its torque by inverse dynamics.
void expect_columns(const robot::Model& model, int load_joint, const std::string& link,
                    unsigned seed) {
  robot::testing::Random random(seed);
  const int n = model.num_joints;
  AdaptiveGains gains;
  gains.kp = gains.kd = gains.a = gains.b = Vector::Constant(n, 10);
  gains.gamma_mass = gains.gamma_moment = gains.gamma_inertia = 1;
  gains.load_joint = load_joint;
  const LoriaOrtegaAdaptive law(model, gains, Settings{1e-3});
  for (int i = 0; i < 200; ++i) {
    const ReferencePoint r{random.vector(n, 3), random.vector(n, 2), random.vector(n, 5),
                           Vector::Zero(n), Vector::Zero(n)};
    const double mass = random.uniform(0.1, 4);
    const Eigen::Vector3d centre = 0.1 * Eigen::Vector3d(random.vector(3, 1));
    const Eigen::Matrix3d any = Eigen::Matrix3d::NullaryExpr([&] { return random.uniform(-1, 1); });
    const Eigen::Matrix3d I = 0.1 * any * any.transpose();  // about the centre
    const robot::Model loaded = robot::with_payload(model, {mass, centre, I}, link);
    const Vector torque = robot::inverse_dynamics(loaded, r.q_ref, r.v_ref, r.a_ref) -
                          robot::inverse_dynamics(model, r.q_ref, r.v_ref, r.a_ref);
    const Eigen::Matrix3d about_origin =
        I +
        mass * (centre.squaredNorm() * Eigen::Matrix3d::Identity() - centre * centre.transpose());
    Eigen::Matrix<double, 10, 1> pi;
    pi << mass, mass * centre, about_origin.diagonal(), about_origin(0, 1), about_origin(0, 2),
        about_origin(1, 2);
    const auto Y = law.columns_at(r, {r.v_ref, r.a_ref});
    // A link of an arm in the plane x, z turns the entry yy alone.
    if (Y.cols() == 5) pi[4] = pi[5];
    ASSERT_TRUE(Y.cols() == 10 || Y.cols() == 5);
    const Vector by_columns = Y * pi.head(Y.cols());
    EXPECT_LE((by_columns - torque).norm(), 1e-11 * (1 + torque.norm())) << i;
  }
}

TEST(LoriaOrtegaAdaptive, ColumnsAreTheTorqueOfALoadOnAnyLink) {
  expect_columns(robot::testing::iiwa7(), 0, "", 1);
  expect_columns(robot::testing::iiwa7(), 4, "link4", 2);
  expect_columns(robot::testing::two_link(), 1, "link1", 3);
}

TEST(LoriaOrtegaAdaptive, LogsWhatItEstimatesAndNothingElse) {
  Random random(6);
  AdaptiveGains gains = example();
  gains.gamma_mass = 0;
  gains.gamma_moment = gains.gamma_inertia = 1;
  gains.moment_max = gains.inertia_max = 2;
  const LoriaOrtegaAdaptive law(two_link_model(), gains, {1e-3, Discretisation::tustin});
  auto memory = law.start({random.pair(1)}, random.reference());
  for (int k = 0; k < 100; ++k) {
    const auto step = law.step(memory, {random.pair(1)}, random.reference());
    memory = step.memory;
    const auto& logged = step.signals.value;
    EXPECT_EQ(Pair(logged[2]), Pair(memory.friction));
    EXPECT_EQ(Pair(logged[3]), Pair::Zero()) << "the mass is known";
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double moment = memory.load[static_cast<Eigen::Index>(axis)];
      EXPECT_EQ(Pair(logged[4 + axis]), Pair(moment, moment));
      EXPECT_LE(std::abs(moment), 2);
    }
    // An arm in the plane x, z turns the entry yy alone.
    ASSERT_EQ(memory.load.size(), 4);
    EXPECT_EQ(Pair(logged[7]), Pair(memory.load[3], 0));
    EXPECT_GE(memory.load[3], 0);
  }
  EXPECT_GT(memory.load[3], 0);
}

TEST(LoriaOrtegaAdaptive, AdaptsToTheEntriesOfTheInertiaThatTheRobotTurns) {
  const auto unknown = [](const robot::Model& model, int load_joint) {
    AdaptiveGains gains;
    gains.kp = gains.kd = gains.a = gains.b = Vector::Constant(model.num_joints, 10);
    gains.gamma_inertia = gains.inertia_max = 1;
    gains.load_joint = load_joint;
    return LoriaOrtegaAdaptive(model, gains, Settings{1e-3}).columns().size();
  };
  EXPECT_EQ(unknown(robot::testing::two_link(), 0), 1U);
  EXPECT_EQ(unknown(robot::testing::iiwa7(), 0), 6U);
  EXPECT_EQ(unknown(robot::testing::iiwa7(), 1), 1U) << "the first joint turns about one axis";
}

TEST(LoriaOrtegaAdaptive, IsTheRigidLawWithoutAdaptation) {
  Random random(2);
  AdaptiveGains gains = example();
  gains.gamma_mass = 0;
  gains.gamma_friction = vector(0, 0);
  const Settings settings{1e-3, Discretisation::tustin, FilterStart::at_error, 1.5e-3};
  const LoriaOrtegaAdaptive law(two_link_model(), gains, settings);
  const LoriaOrtegaRigid rigid(two_link_model(), {gains.kp, gains.kd, gains.a, gains.b}, settings);
  auto memory = law.start({random.pair(1)}, random.reference());
  auto same = memory.filter;
  for (int k = 0; k < 100; ++k) {
    const messages::PositionMeasurement measured{random.pair(1)};
    const ReferencePoint reference = random.reference();
    const auto step = law.step(memory, measured, reference);
    const auto expected = rigid.step(same, measured, reference);
    EXPECT_EQ(step.command.tau, expected.command.tau);
    memory = step.memory;
    same = expected.memory;
  }
}

TEST(LoriaOrtegaAdaptive, AdaptsNothingAtItsFirstStepAndStaysInTheBox) {
  Random random(3);
  for (const FilterStart start : {FilterStart::at_error, FilterStart::zero}) {
    const LoriaOrtegaAdaptive law(two_link_model(), example(),
                                  {1e-3, Discretisation::tustin, start});
    const messages::PositionMeasurement measured{random.pair(1)};
    const ReferencePoint reference = random.reference();
    auto memory = law.start(measured, reference);
    const auto first = law.step(memory, measured, reference);
    EXPECT_LE(std::abs(first.memory.load[0]), 1e-12);
    EXPECT_LE(first.memory.friction.norm(), 1e-12);
    memory = first.memory;
    for (int k = 0; k < 1000; ++k) {
      memory = law.step(memory, {random.pair(10)}, random.reference()).memory;
      ASSERT_GE(memory.load[0], 0);
      ASSERT_LE(memory.load[0], 3);
      ASSERT_GE(memory.friction.minCoeff(), 0);
      ASSERT_LE(memory.friction[0], 20);
      ASSERT_LE(memory.friction[1], 5);
    }
  }
}

/// The mass is that of the tip, the frictions those of the joints; all are unknown to the law.
TEST(LoriaOrtegaAdaptive, FindsAMassAndFrictionsThatTheMotionExcites) {
  const LoriaOrtegaAdaptive law(two_link_model(), example(),
                                {1e-3, Discretisation::tustin, FilterStart::at_error, 1.5e-3});
  const RigidArm arm{TwoLink<double>{0.5}};
  const Pair friction(8, 1.5);
  const auto reference = [](double t) {
    const Sine first{{0.8, 0}, 3}, second{{0, 0.6}, 4};
    ReferencePoint sum = first.at(t);
    const ReferencePoint other = second.at(t);
    sum.q_ref += other.q_ref;
    sum.v_ref += other.v_ref;
    sum.a_ref += other.a_ref;
    sum.jerk_ref += other.jerk_ref;
    sum.snap_ref += other.snap_ref;
    return sum;
  };
  const ReferencePoint at_start = reference(0);
  State<4> x = rigid_state(at_start.q_ref, at_start.v_ref);
  auto memory = law.start(arm.position(x), at_start);
  Pair applied = Pair::Zero(), most = Pair::Zero();
  constexpr int ticks = 8000;
  for (int k = 0; k < ticks; ++k) {
    const ReferencePoint r = reference(k * 1e-3);
    if (k >= ticks - 1000) most = most.cwiseMax((x.head<2>() - Pair(r.q_ref)).cwiseAbs());
    const auto step = law.step(memory, arm.position(x), r);
    memory = step.memory;
    if (k == 0) applied = step.command.tau;
    const auto braked = [&](double /*t*/, const State<4>& y) -> State<4> {
      return arm(y, applied - friction.cwiseProduct(y.tail<2>()));
    };
    for (int part = 0; part < 2; ++part) x = runge_kutta_4(braked, 0, x, 0.5e-3);
    applied = step.command.tau;
  }
  EXPECT_NEAR(memory.load[0], 0.5, 0.01);
  EXPECT_NEAR(memory.friction[0], 8, 0.2);
  EXPECT_NEAR(memory.friction[1], 1.5, 0.1);
  // Another program has the same without encoder counts: 2.101e-5 and 6.425e-5.
  EXPECT_NEAR(most[0], 2.101e-5, 0.002e-5);
  EXPECT_NEAR(most[1], 6.425e-5, 0.007e-5);
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_adaptive_test
