#include "controller/law/loria_ortega_rigid.h"

#include <gtest/gtest.h>

#include "controller/law/rivals/kelly_regulation.h"
#include "tests/controller/law/two_link.h"
#include "tests/support/rounding.h"

namespace tachless::controller::law::loria_ortega_rigid_test {
namespace {

LoriaOrtegaRigid::Gains papers_gains() {
  return {vector(5000, 6000), vector(7000, 8800), vector(1000, 1000), vector(1000, 1000)};
}

TEST(LoriaOrtegaRigid, IsThePapersLawOnItsArm) {
  // Eq. 4-5 with the closed-form model; 100 eps of the largest term, which both round.
  const TwoLink<double> arm;
  const Settings settings{5e-5};
  const LoriaOrtegaRigid::Gains gains = papers_gains();
  const LoriaOrtegaRigid law(two_link_model(), gains, settings);
  const FilterCoefficients filter =
      filter_coefficients(settings.filter, 1000, 1000, settings.period_s);
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const LoriaOrtegaRigid::Memory memory{random.pair(10), random.pair(1)};
    const messages::PositionMeasurement measured{random.pair(3)};
    const messages::ReferencePoint ref = random.reference();
    const auto step = law.step(memory, measured, ref);

    const Pair e = measured.q - ref.q_ref;
    const Pair nu = filter.phi * memory.nu + filter.beta * (e - memory.e_previous);
    const Pair feedforward = arm.torque(measured.q, ref.v_ref, ref.v_ref, ref.a_ref);
    const Pair tau = feedforward - gains.kp.cwiseProduct(e) - gains.kd.cwiseProduct(nu);
    const double size =
        (gains.kd.cwiseProduct(nu)).norm() + (gains.kp.cwiseProduct(e)).norm() + feedforward.norm();
    EXPECT_LE((step.command.tau - tau).norm(), 100 * eps * size);
    EXPECT_EQ(step.signals.num, 2);
    EXPECT_EQ(step.signals.value[0], e);
    EXPECT_EQ(step.signals.value[1], step.memory.nu);
    EXPECT_EQ(step.memory.e_previous, e);
    EXPECT_LE((step.memory.nu - nu).norm(), 10 * eps * 1000 * 6);
  }
}

TEST(LoriaOrtegaRigid, AtRestIsKellysRegulator) {
  Random random(2);
  for (const FilterStart start : {FilterStart::at_error, FilterStart::zero}) {
    const Settings settings{1e-3, Discretisation::tustin, start, 0};
    const LoriaOrtegaRigid tracking(two_link_model(), papers_gains(), settings);
    const KellyRegulation regulation(
        two_link_model(),
        {vector(5000, 6000), vector(7000, 8800), vector(1000, 1000), vector(1000, 1000)}, settings);
    const Vector zero = Vector::Zero(2);
    const messages::ReferencePoint goal{random.pair(2), zero, zero, zero, zero};
    messages::PositionMeasurement measured{random.pair(2)};
    auto one = tracking.start(measured, goal);
    auto other = regulation.start(measured, goal);
    for (int k = 0; k < 100; ++k) {
      const auto step = tracking.step(one, measured, goal);
      const auto same = regulation.step(other, measured, goal);
      // ID(q, 0, 0) and g(q) may add their zeros in another order: rounding of g, <= 90 N m.
      EXPECT_LE((step.command.tau - same.command.tau).norm(), 10 * eps * 90);
      EXPECT_EQ(step.memory.nu, same.memory.nu);
      one = step.memory;
      other = same.memory;
      measured.q += random.pair(0.01);
    }
  }
}

TEST(LoriaOrtegaRigid, StartsWithoutAKick) {
  const LoriaOrtegaRigid law(two_link_model(), papers_gains(), {5e-5});
  const Vector zero = Vector::Zero(2);
  const messages::ReferencePoint goal{zero, zero, zero, zero, zero};
  const messages::PositionMeasurement measured{vector(0.5, -0.5)};
  const auto step = law.step(law.start(measured, goal), measured, goal);
  EXPECT_EQ(step.signals.value[1], zero);
}

TEST(LoriaOrtegaRigid, KicksWithTheRawTransferFunction) {
  const LoriaOrtegaRigid law(two_link_model(), papers_gains(),
                             {5e-5, Discretisation::first_order_hold, FilterStart::zero, 0});
  const Vector zero = Vector::Zero(2);
  const messages::ReferencePoint goal{zero, zero, zero, zero, zero};
  const messages::PositionMeasurement measured{vector(0.5, -0.5)};
  const auto step = law.step(law.start(measured, goal), measured, goal);
  // Kd B e(0) = 7000 * 1000 * 0.5 N m on joint 1: millions.
  EXPECT_NEAR(step.command.tau[0], -3.5e6, 3000);
}

TEST(LoriaOrtegaRigid, LeadMovesTheFeedForwardAndNothingElse) {
  const TwoLink<double> arm;
  const double lead = 1.5e-3;
  const LoriaOrtegaRigid now(two_link_model(), papers_gains(), {1e-3});
  const LoriaOrtegaRigid ahead(
      two_link_model(), papers_gains(),
      {1e-3, Discretisation::first_order_hold, FilterStart::at_error, lead});
  Random random(3);
  for (int i = 0; i < 100; ++i) {
    const messages::PositionMeasurement measured{random.pair(2)};
    const messages::ReferencePoint ref = random.reference();
    const LoriaOrtegaRigid::Memory memory{random.pair(1), random.pair(1)};
    const auto one = now.step(memory, measured, ref);
    const auto other = ahead.step(memory, measured, ref);
    EXPECT_EQ(one.memory.nu, other.memory.nu);
    EXPECT_EQ(one.signals.value[0], other.signals.value[0]);
    const Pair v = ref.v_ref + lead * ref.a_ref + lead * lead / 2 * ref.jerk_ref +
                   lead * lead * lead / 6 * ref.snap_ref;
    const Pair a = ref.a_ref + lead * ref.jerk_ref + lead * lead / 2 * ref.snap_ref;
    const Pair difference =
        arm.torque(measured.q, v, v, a) - arm.torque(measured.q, ref.v_ref, ref.v_ref, ref.a_ref);
    // The difference of two torques in which Kd nu, up to 1e7 N m, has been rounded.
    EXPECT_LE((other.command.tau - one.command.tau - difference).norm(), 10 * eps * 3e7);
  }
}

TEST(FeedforwardAhead, IsTheTaylorExpansionOfASmoothReference) {
  // q_ref = sin(10 pi t) / (10 pi). The neglected terms are lead^4 / 24 (10 pi)^4 of v_ref and
  // lead^3 / 6 (10 pi)^4 of a_ref.
  const double w = 10 * M_PI, t = 0.0123, lead = 1.5e-3;
  const auto at = [&](double x) {
    const double s = std::sin(w * x) / w, c = std::cos(w * x);
    const Vector one = Vector::Ones(1);
    return messages::ReferencePoint{s * one, c * one, -w * w * s * one, -w * w * c * one,
                                    w * w * w * w * s * one};
  };
  const Feedforward ahead = feedforward_ahead(at(t), lead);
  EXPECT_NEAR(ahead.v_ref[0], at(t + lead).v_ref[0], std::pow(w * lead, 4) / 24);
  EXPECT_NEAR(ahead.a_ref[0], at(t + lead).a_ref[0], w * std::pow(w * lead, 3) / 6);
  EXPECT_EQ(feedforward_ahead(at(t), 0).v_ref, at(t).v_ref);
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_rigid_test
