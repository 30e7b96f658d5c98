// The loop inside the drives, against numbers of an independent program (a map and a nonlinear
// simulation of the two-link arm at q = (0.3, 0.8), drives at 10 kHz with one tick of delay and a
// velocity of 200 Hz), and against the emulated drives themselves.
#include "linear/drive_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "numerics/decompositions.h"
#include "plant/drive_loop.h"
#include "plant/plant_model.h"
#include "robot/dynamics.h"
#include "scenario/drive_loop.h"
#include "tests/analysis/linear/linear_laws.h"
#include "tests/analysis/linear/loops.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::linear::drive_loop_test {
namespace {

using namespace linear::testing;
using controller::law::Discretisation;
using controller::law::FilterGains;
using Eigen::Vector2d;

const Vector posture = Vector2d(0.3, 0.8), stiff = Vector2d(4000, 400), damped = Vector2d(300, 30),
             none = Vector::Zero(2);

scenario::DriveLoopSpec drives(const Vector& kp, const Vector& kd, int late_ticks) {
  scenario::DriveLoopSpec spec;
  spec.period_s = 1e-4;
  spec.kp = kp;
  spec.kd = kd;
  spec.velocity_filter_hz = 200;
  spec.late_ticks = late_ticks;
  return spec;
}

SplitLoop split(const scenario::DriveLoopSpec& spec, double period_s, int delay,
                const Vector& host_kp, const Vector& host_kd,
                const robot::Model& model = robot::testing::two_link(), double host_rate = 200) {
  const messages::ReferencePoint rest = constant_reference(posture);
  const Vector rate = Vector2d(host_rate, host_rate);
  return {rigid_plant(model, rest), spec,
          linear_rigid_law(FilterGains{host_kp, host_kd, rate, rate}, gradient_by_q(model, rest),
                           {Discretisation::tustin, period_s}),
          period_s, delay};
}

double radius(const SplitLoop& loop) { return spectral_radius(loop.map()); }

/// kp and kd in the drives, the host at 200 Hz and 4 ms late.
SplitLoop all_in_the_drives() { return split(drives(stiff, damped, 40), 5e-3, 0, none, none); }

TEST(DriveLoop, HasTheRadiusAndTheLimitsOfAnIndependentProgram) {
  EXPECT_NEAR(radius(all_in_the_drives()), 0.93650, 5e-6);
  const DriveMargins margins = drive_margins(all_in_the_drives());
  EXPECT_NEAR(margins.gain, 88.0, 0.05);
  EXPECT_EQ(1 + margins.delay_ticks, 171) << "of the drives, one of which they have";
  EXPECT_NEAR(margins.modulus, 0.712, 2e-3);
  // No feedback passes through the host.
  EXPECT_EQ(host_delay_margin(all_in_the_drives()), most_host_ticks * 50);
}

TEST(DriveLoop, BoundsTheDelayOfAHostWithKp) {
  const SplitLoop prompt = split(drives(none, damped, 0), 5e-3, 0, stiff, none);
  EXPECT_EQ(host_delay_margin(prompt), 938);
  const SplitLoop late = split(drives(none, damped, 40), 5e-3, 0, stiff, none);
  EXPECT_NEAR(-std::log(radius(late)) / 5e-3, 11.9, 0.05);
  EXPECT_NEAR(drive_margins(late).modulus, 0.690, 2e-3);
  EXPECT_NEAR(margins({late.plant(), [&](double) { return late.law; }, late.delay}, 5e-3).modulus,
              0.723, 2e-3);
}

TEST(DriveLoop, BoundsTheDelayOfAHostThatHasTheWholeLaw) {
  const SplitLoop loop = split(drives(none, none, 0), 1e-3, 0, stiff, damped);
  EXPECT_EQ(host_delay_margin(loop), 130);
}

/// Gains of 0 inside the drives leave the loop without them: its torque is one tick of the drives
/// later.
TEST(DriveLoop, OfGainsOfZeroIsTheLoopWithoutIt) {
  scenario::DriveLoopSpec spec = drives(none, none, 0);
  spec.delay_ticks = 0;
  const SplitLoop loop = split(spec, 1e-3, 1, stiff, damped);
  EXPECT_NEAR(radius(loop), spectral_radius(cut(loop.arm, loop.law, 1e-3, 1).closed()), 1e-9);
  const LinearPlant plain = without_drive_loop(loop.plant());
  EXPECT_EQ(plain.A, loop.arm.A);
  EXPECT_EQ(plain.B, loop.arm.B);
}

TEST(DriveLoop, ModulusIsThatOfTheLiftedLoopBySingularValues) {
  // One tick of the drives in a period: the lifted loop is the loop, and its modulus the least
  // singular value of 1 + L, which Margins::modulus_independent is for the host's.
  scenario::DriveLoopSpec spec = drives(stiff, damped, 0);
  spec.period_s = 1e-3;
  spec.delay_ticks = 0;
  spec.velocity_filter_hz.reset();
  // A compensation of gravity would be cut with the torques of the one, not with the other's.
  robot::Model model = robot::testing::two_link();
  model.gravity.setZero();
  const SplitLoop inside = split(spec, 1e-3, 0, none, none, model);
  // The same law in the host: a filter with a = 2 / h and b = a is a difference.
  spec.kp = spec.kd = none;
  const SplitLoop host = split(spec, 1e-3, 0, stiff, damped, model, 2000);
  ASSERT_NEAR(radius(host), radius(inside), 1e-9);
  const Margins of_host = margins({host.arm, [&](double) { return host.law; }, host.delay}, 1e-3);
  EXPECT_NEAR(drive_margins(inside).modulus, of_host.modulus_independent, 1e-4);
}

/// Positions at the host's ticks, less the posture.
std::vector<Vector> simulated(const Vector& from, int ticks) {
  const SplitLoop loop = all_in_the_drives();
  const scenario::Scenario scenario =
      shipped("practical_rigid", {"plant.mechanics=native", "plant.integrator.accuracy=1e-14",
                                  fmt::format("plant.initial.position_rad=[{:.17g}, {:.17g}]",
                                              posture[0] + from[0], posture[1] + from[1])});
  const robot::Model model = plant::plant_model(scenario);
  plant::EmulatedDriveLoop robot(std::make_unique<plant::EmulatedRobot>(
                                     scenario.plant, scenario.robot.flexible, loop.period_s, model),
                                 loop.drive, none, {});
  std::vector<Vector> all;
  for (int k = 0; k < ticks; ++k) {
    const Vector q = robot.read().q;
    all.emplace_back(q - posture);
    robot.follow(robot::gravity_torque(model, q), {posture, none}, (k + 1) * loop.period_s);
  }
  return all;
}

TEST(DriveLoop, MapIsTheEmulatedDrivesToAHundredMillionthOfTheState) {
  constexpr int ticks = 60;
  const SplitLoop loop = all_in_the_drives();
  const LinearPlant plant = loop.plant();
  const Vector d = 3e-5 * Vector2d(1, -0.7);
  const std::vector<Vector> plus = simulated(d, ticks), minus = simulated(-d, ticks);
  const Index n = 2, acting = plant.drive->acting(n);
  Eigen::VectorXd z = Eigen::VectorXd::Zero(loop.map().rows());
  z.head(n) = d;
  const Vector gravity = loop.law.compensation * d;
  for (Index row = acting; row + n < plant.A.rows(); row += n) {
    z.segment(row, n) = gravity - stiff.cwiseProduct(d);
  }
  z.segment(plant.A.rows() - n, n) = gravity;
  double worst = 0;
  for (int k = 0; k < ticks; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const Vector odd = (plus[i] - minus[i]) / 2;
    worst = std::max(worst, (odd - z.head(n)).cwiseAbs().maxCoeff());
    z = loop.map() * z;
  }
  EXPECT_LT(worst, 1e-8 * d.cwiseAbs().maxCoeff());
  EXPECT_LT(z.head(n).norm(), 0.1 * d.norm());
}

TEST(DriveLoop, TorqueOfACountHasTheFilterOfTheVelocity) {
  const Vector torque = drive_count_torque(drives(stiff, damped, 0), Vector2d(1, 1));
  EXPECT_NEAR(torque[0], 339'000, 500);
}

TEST(DriveLoop, IsReadFromTheScenarioAndRefusedInWords) {
  using ::testing::HasSubstr;
  const auto with = [](const std::string& loop) {
    return scenario::drive_loop(shipped("practical_rigid", {"plant.drive.loop=" + loop}));
  };
  EXPECT_FALSE(scenario::drive_loop(shipped("practical_rigid")));
  const auto loop = with("{period_s: 1.0e-4, kp: 100, kd: [3, 1], velocity_filter_hz: 200}");
  ASSERT_TRUE(loop);
  EXPECT_EQ(loop->kp, Vector(Vector2d(100, 100)));
  EXPECT_EQ(loop->kd, Vector(Vector2d(3, 1)));
  EXPECT_EQ(loop->delay_ticks, 1);
  const auto fault = [&](const std::string& text) -> std::string {
    try {
      with(text);
    } catch (const base::Failure& failure) {
      return failure.what();
    }
    return "";
  };
  EXPECT_THAT(fault("{period_s: 1.0e-4, kp: 100}"), HasSubstr("plant.drive.loop.kd: missing"));
  EXPECT_THAT(fault("{period_s: 3.0e-4, kp: 100, kd: 1}"),
              HasSubstr("plant.drive.loop.period_s: 3e-04; loop.period_s (0.001) is 3.33333"));
  EXPECT_THAT(fault("{period_s: 1.0e-4, kp: 1, kd: 1, late_ticks: 10}"),
              HasSubstr("plant.drive.loop.late_ticks: 10"));
  EXPECT_THAT(fault("{period_s: 1.0e-4, kp: 1, kd: 1, rate: 3}"),
              HasSubstr("plant.drive.loop.rate: unknown"));
  EXPECT_THAT(fault("5"), HasSubstr("plant.drive.loop"));
  try {
    shipped("practical_flexible", {"plant.drive.loop={period_s: 1.0e-4, kp: 1, kd: 1}"});
    FAIL();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("the robot's joints are flexible"));
  }
}

}  // namespace
}  // namespace tachless::linear::drive_loop_test
