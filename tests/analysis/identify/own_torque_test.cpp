// Arms that add gravity's torque themselves. That torque acts at once, and the one that they are
// sent acts late.

#include "plant/own_torque.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "commission/emulated_arm.h"
#include "identify/recording.h"
#include "robot/dynamics.h"
#include "tests/analysis/identify/hidden_arm.h"
#include "tests/analysis/identify/table_of_motion.h"

namespace tachless::identify::own_torque_test {
namespace {

using Eigen::Index;
using testing::IsEmpty;
using testing::Not;

/// Returns the two-link arm of `hidden_arm.h` with an arm that adds gravity.
/// @param friction share of the friction that the arm cancels
scenario::Scenario compensated(const char* bits, double seconds, double friction) {
  scenario::Scenario believed = scenario("practical_rigid", bits, seconds);
  believed.robot.compensates.gravity = true;
  believed.robot.compensates.friction = friction;
  believed.plant.drive.torque_limit_Nm = Vector::Constant(2, 1e3);
  believed.plant.following_error_rad = Vector::Constant(2, 1);
  believed.plant.initial.torque = plant::InitialTorque::hold;
  return believed;
}

/// Rotors, viscous and Coulomb friction, payload. An arm that cancels its friction has none.
Eigen::VectorXd truth_of(double friction) {
  const double left = 1 - friction;
  Eigen::VectorXd truth(7);
  truth << 1, 0.2, 3 * left, 0.9 * left, 3.3 * left, left, 0;
  return truth;
}

/// Rate of the arm's controller, which computes gravity: the loop's, or a much higher one.
enum class Rate { of_loop, higher };

/// Returns the recording of a run of a driver's arm, whose readings are `late` ticks old.
/// @param controlled the law is known
Recording run_of_driver(const scenario::Scenario& believed, double friction, int late,
                        bool controlled = true, Rate rate = Rate::of_loop) {
  scenario::Scenario plant = hidden(believed, truth_of(friction));
  plant.plant.encoder.latency_ticks = late;
  if (rate == Rate::higher) {  // gravity and what the arm adds cancel at every instant
    robot::Model weightless = *plant.model;
    weightless.gravity.setZero();
    plant.model = std::make_shared<robot::Model>(weightless);
    plant.robot.compensates.gravity = false;
  }
  commission::EmulatedArm arm(plant);
  Recording run = record(believed, believed, &arm);
  run.controlled = controlled;
  set_own_torque(run, true);
  return run;
}

/// Returns the names of what is wrong: values off by more than twice their half widths, wide
/// intervals, a delay that is off, joints with a misfit.
/// @param late delay [ticks]
/// @param most half width of friction and rotors [N m s/rad; N m; kg m2]
std::vector<std::string> wrong(const Identified& found, double friction, double late, double most) {
  const Eigen::VectorXd truth = truth_of(friction);
  std::vector<std::string> names;
  for (Index i = 0; i < std::ssize(found.parameters); ++i) {
    const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
    const bool is_delay = each.entry.kind == Kind::delay;
    if (!is_delay && i >= truth.size()) {  // a further term of friction, which the arm has not
      names.push_back(each.entry.name);
      continue;
    }
    const double off = std::abs(each.value - (is_delay ? late : truth[i]));
    const bool right = is_delay ? off < 0.02 : off <= 2 * each.half_width && each.half_width < most;
    if (!right) names.push_back(each.entry.name);
  }
  for (const Identified::Check& each : found.checks) {
    if (each.misfit.found) names.push_back(each.joint);
  }
  return names;
}

/// Gravity that acts two rows of 5 ms late looks like viscous friction.
TEST(OwnTorque, OfATableActsAtOnce) {
  for (const double friction : {0.0, 1.0}) {
    const scenario::Scenario believed = compensated("20", 15, friction);
    const Eigen::VectorXd truth = truth_of(friction);
    robot::Model arm = *believed.model;
    arm.rotor_inertia = truth.head(2);
    Recording table =
        table_of_motion(believed, arm, 20, 0, [&](Index joint, double v, double /*load*/) {
          return truth[2 + joint] * v + (v > 0 ? 1 : -1) * truth[4 + joint];
        });
    const Eigen::MatrixXd acts = table.tau;
    constexpr Index late = 2;
    const Index rows = table.num_ticks() - late;
    for (Index k = 0; k < rows; ++k) {
      const Vector now = robot::gravity_torque(arm, table.q.row(k).transpose());
      const Vector then = robot::gravity_torque(arm, table.q.row(k + late).transpose());
      table.tau.row(k) = acts.row(k + late) + (now - then).transpose();
    }
    table.q.conservativeResize(rows, Eigen::NoChange);
    table.tau.conservativeResize(rows, Eigen::NoChange);
    const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::delay};
    const Identified whole = identify({table}, unknown, {}, ignore);
    set_own_torque(table, false);
    const Identified found = identify({table}, unknown, {}, ignore);
    EXPECT_THAT(wrong(found, friction, late, 0.05), IsEmpty());
    EXPECT_THAT(wrong(whole, friction, late, 0.05), Not(IsEmpty()));
  }
}

/// The simulated arm adds gravity at once, too. The drives of the scenario hold each command for a
/// tick besides.
TEST(OwnTorque, OfADriversArmActsAtOnce) {
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::delay};
  for (const double friction : {0.0, 1.0}) {
    const scenario::Scenario believed = compensated("20", 5, friction);
    ASSERT_EQ(believed.loop.command_delay, 1);
    Recording run = run_of_driver(believed, friction, 1);
    EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), friction, 2, 0.03), IsEmpty());
    run.own.resize(0, 0);
    EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), friction, 2, 0.03), Not(IsEmpty()));
  }
}

/// Gravity of the shoulder changes by 81 N m/rad. Half a tick of it is like 0.04 N m s/rad.
TEST(OwnTorque, OfAFastControllerActsWithinATick) {
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::delay};
  for (const bool controlled : {true, false}) {
    const double seconds = controlled ? 5 : 15, late = controlled ? 2 : 1.5;
    const Recording run =
        run_of_driver(compensated("20", seconds, 0), 0, 1, controlled, Rate::higher);
    EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), 0, late, controlled ? 0.03 : 0.05),
                IsEmpty());
  }
}

/// Torques that the arm told: they are held over a tick, in the mean half a tick late, and the
/// readings are a tick old. The command itself has the scenario's delay already.
TEST(OwnTorque, OfADriversArmActsAtOnceWithoutAKnownLaw) {
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::delay};
  Recording run = run_of_driver(compensated("20", 15, 0), 0, 1, false);
  EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), 0, 1.5, 0.05), IsEmpty());
  run.own.resize(0, 0);
  EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), 0, 1.5, 0.05), Not(IsEmpty()));
}

/// Readings whose age the scenario knows.
TEST(OwnTorque, OfADriversArmActsAtOnceWithAKnownDelay) {
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb};
  scenario::Scenario believed = compensated("20", 5, 0);
  believed.plant.encoder.latency_ticks = 2;
  Recording run = run_of_driver(believed, 0, 2);
  EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), 0, 0, 0.03), IsEmpty());
  run.own.resize(0, 0);
  EXPECT_THAT(wrong(identify({run}, unknown, {}, ignore), 0, 0, 0.03), Not(IsEmpty()));
}

}  // namespace
}  // namespace tachless::identify::own_torque_test
