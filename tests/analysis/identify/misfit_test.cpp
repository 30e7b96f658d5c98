// Intervals of tables, and whether a wrong model is called wrong.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "identify/misfit.h"
#include "tests/analysis/identify/hidden_arm.h"
#include "tests/analysis/identify/table_of_motion.h"

namespace tachless::identify::misfit_test {
namespace {

using Eigen::Index;
using testing::HasSubstr;
using testing::Not;

const std::vector<Kind> seen_in_tables = {Kind::rotor, Kind::viscous, Kind::coulomb};
const std::vector<Kind> of_table = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::delay};

/// Rotors, viscous and Coulomb friction, payload of the two-link arm.
const Eigen::VectorXd hidden_truth = (Eigen::VectorXd(7) << 1, 0.2, 3, 0.9, 3.3, 1, 0).finished();

Recording log_of(const scenario::Scenario& plant, const scenario::Scenario& believed) {
  return record(believed, plant);
}

/// Returns the run's table: the torques that act at its instants.
Recording table_of(const Recording& run) {
  Recording table = run;
  table.controlled = false;
  const Index rows = run.num_ticks();
  table.tau.bottomRows(rows - 1) = 0.5 * (run.tau.topRows(rows - 1) + run.tau.bottomRows(rows - 1));
  return table;
}

Recording hidden_table(double seconds) {
  const scenario::Scenario believed = scenario("practical_rigid", "18", seconds);
  return table_of(log_of(hidden(believed, hidden_truth), believed));
}

/// Expects narrow intervals and errors below twice their half widths.
void expect_true_values(const Identified& found, double most) {
  for (Index i = 0; i < 6; ++i) {
    const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
    EXPECT_EQ(each.doubt, "") << each.entry.name;
    EXPECT_LT(std::abs(each.value - hidden_truth[i]), 2 * each.half_width) << each.entry.name;
    EXPECT_LT(each.half_width, most * hidden_truth[i]) << each.entry.name;
  }
}

/// Returns the run's table with its commands as torques. They act a tick later and are held over
/// it, so that they are one and a half ticks late in the mean.
Recording commands_of(const Recording& run) {
  Recording table = run;
  table.controlled = false;
  const Index rows = run.num_ticks();
  table.tau.topRows(rows - 1) = run.tau.bottomRows(rows - 1);
  return table;
}

/// 95 % of 60 intervals are 57 +- 1.7. With 20 bits the intervals are below a thousandth, so that a
/// delay of half a tick and the differences over a tick count.
TEST(Tables, IntervalsHold) {
  using Made = Recording (*)(const Recording&);
  for (const auto& [bits, made] :
       {std::pair<const char*, Made>{"18", table_of}, {"20", table_of}, {"20", commands_of}}) {
    const scenario::Scenario believed = scenario("practical_rigid", bits, 12);
    std::mt19937 random(3);
    int held = 0;
    for (int arm = 0; arm < 10; ++arm) {
      Eigen::VectorXd truth = draw_truth(believed, Parameters(believed, all), random);
      truth[6] = 0;  // no payload
      const Identified found =
          identify({made(log_of(hidden(believed, truth), believed))}, of_table, {}, ignore);
      for (Index i = 0; i < 6; ++i) {
        const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
        held += std::abs(each.value - truth[i]) <= each.half_width ? 1 : 0;
      }
      for (const Identified::Check& each : found.checks) {
        EXPECT_FALSE(each.misfit.found) << each.joint;
      }
      EXPECT_EQ(std::ssize(found.parameters), 7) << "no further term of friction";
    }
    EXPECT_GE(held, 53) << bits << (made == commands_of ? " bits, commands" : " bits");
  }
}

/// Torques at the instants of a motion need accelerations at these instants. A difference over
/// three positions is the mean over two steps: 2e-4 less at 10 rad/s and 200 Hz, 1.6e-4 of the
/// 0.75 kg m2 that the elbow turns. A table's torques may be such means, so that the middle is
/// taken, half as far from the truth. The interval contains both, but for a second order of 1e-3.
TEST(Tables, TheAccelerationIsThatOfTheInstant) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", 2);
  robot::Model arm = *believed.model;
  arm.rotor_inertia = hidden_truth.head(2);
  const auto path = [](Index joint, double t) { return joint == 0 ? 0.0 : 0.3 * std::sin(10 * t); };
  const Recording table = table_of_path(believed, arm, 10, path, [](auto...) { return 0.0; });
  const Identified found = identify({table}, {Kind::rotor}, {}, ignore);
  const Identified::Parameter& rotor = found.parameters[1];
  EXPECT_NEAR(rotor.value, hidden_truth[1], std::min(1.01 * rotor.half_width, 1.2e-4));
}

/// Filtered signs of the velocity are wrong around reversals. Rows there would bias every number.
TEST(Tables, SlowRowsDoNotBiasTheAnswer) {
  const Identified found = identify({hidden_table(14)}, of_table, {}, ignore);
  expect_true_values(found, 0.02);
  for (const Identified::Check& each : found.checks) EXPECT_FALSE(each.misfit.found) << each.joint;
}

/// An arm at rest may have any friction up to Coulomb's.
TEST(Tables, RestAtTheEndDoesNotBiasTheAnswer) {
  Recording table = hidden_table(14);
  const Index rows = table.num_ticks(), rest = 4000;
  table.q.conservativeResize(rows + rest, Eigen::NoChange);
  table.tau.conservativeResize(rows + rest, Eigen::NoChange);
  table.q.bottomRows(rest).rowwise() = table.q.row(rows - 1);
  table.tau.bottomRows(rest).rowwise() = table.tau.row(rows - 1);
  expect_true_values(identify({table}, of_table, {}, ignore), 0.02);
}

/// Commanded torques act later. The table does not say when.
TEST(Tables, TheDelayOfTheirTorquesIsFound) {
  const Recording aligned = hidden_table(14);
  for (const double late : {-3.0, 0.0, 1.0, 2.4, 6.0}) {
    Recording table = with_torques_moved(aligned, -late);
    table.moved = 0;
    const Identified found = identify({table}, of_table, {}, ignore);
    expect_true_values(found, 0.02);
    EXPECT_NEAR(found.parameters.back().value, late, 0.1);
    for (const std::string& each : found.overrides) EXPECT_THAT(each, Not(HasSubstr("delay")));
  }
}

TEST(Tables, AJointThatStandsStillIsNamedWithWhatWouldHelp) {
  Recording table = hidden_table(10);
  table.q.col(1).setConstant(table.q(0, 1));
  const Identified found = identify({table}, seen_in_tables, {}, ignore);
  EXPECT_THAT(found.parameters[3].doubt, HasSubstr("the joint hardly moves"));
  EXPECT_THAT(found.advice, testing::Contains(HasSubstr("motion of elbow")));
}

/// Returns the table of an arm with viscous and Coulomb friction.
Recording dry_table(const scenario::Scenario& scenario, const robot::Model& arm) {
  return table_of_motion(scenario, arm, 15, 0, [](Index /*joint*/, double v, double /*load*/) {
    return 2 * v + (v > 0 ? 2 : -2);
  });
}

struct Wrong {
  const char* what;
  JointError error;
};

/// Each error of the torque is above 3 % of its peak, which is 100 N m at the shoulder.
TEST(Tables, AWrongModelIsCalledWrong) {
  const scenario::Scenario arm = scenario("practical_rigid", "20", 2);
  const auto sign = [](double v) { return v > 0 ? 1.0 : -1.0; };
  const std::vector<Wrong> wrong = {
      {"friction with the load",
       [&](Index /*j*/, double v, double load) {
         return 2 * v + sign(v) * (2 + 0.1 * std::abs(load));
       }},
      {"quadratic friction",
       [&](Index /*j*/, double v, double /*load*/) {
         return 2 * v * (1 + 4 * std::abs(v)) + 2 * sign(v);
       }},
      {"more friction one way",
       [&](Index /*j*/, double v, double /*load*/) { return 2 * v + (v > 0 ? 8 : -3); }},
      {"a torque constant",
       [&](Index /*j*/, double v, double load) { return 2 * v + 2 * sign(v) - 0.1 * load; }}};
  for (const Wrong& each : wrong) {
    Recording table = table_of_motion(arm, *arm.model, 15, 0, each.error);
    add_noise(table, 0.01);
    const Identified found = identify({table}, of_table, {}, ignore);
    EXPECT_TRUE(std::ranges::any_of(found.checks, [](const auto& of) { return of.misfit.found; }))
        << each.what;
    EXPECT_THAT(identify::text(found, "arm"), HasSubstr("the model lacks something at "))
        << each.what;
  }
  Recording right = dry_table(arm, *arm.model);
  add_noise(right, 0.01);
  EXPECT_THAT(identify::text(identify({right}, of_table, {}, ignore), "arm"),
              Not(HasSubstr("lacks something")));
}

/// The base leans by 2.5 degrees, the elbow's zero is off by 0.1 rad, springs of 1000 and
/// 500 N m/rad are between the encoders and the links. Each changes torques by more than 3 % of the
/// shoulder's peak.
TEST(Tables, WrongGeometryIsCalledWrong) {
  const scenario::Scenario arm = scenario("practical_rigid", "20", 2);
  robot::Model leaning = *arm.model;
  leaning.gravity = 9.81 * Eigen::Vector3d(-std::sin(0.044), 0, -std::cos(0.044));
  const Recording tilted = dry_table(arm, leaning);
  Recording shifted = dry_table(arm, *arm.model);
  shifted.q.col(1).array() += 0.1;
  Recording elastic = table_of_motion(arm, *arm.model, 15, 0, [](auto...) { return 0.0; });
  for (Index k = 0; k < elastic.num_ticks(); ++k) {
    elastic.q.row(k) += elastic.tau.row(k).cwiseQuotient(Eigen::RowVector2d(1000, 500));
  }
  for (Recording table : {tilted, shifted, elastic}) {
    add_noise(table, 0.01);
    const Identified found = identify({table}, of_table, {}, ignore);
    EXPECT_THAT(identify::text(found, "arm"), HasSubstr("the model lacks something at "));
  }
}

/// The test looks at every recording.
TEST(Tables, AWrongSecondRecordingIsCalledWrong) {
  const scenario::Scenario arm = scenario("practical_rigid", "20", 2);
  const auto table = [&](double constant, double seed) {
    Recording of =
        table_of_motion(arm, *arm.model, 15, seed, [&](Index /*j*/, double v, double load) {
          return 2 * v + (v > 0 ? 2 : -2) - constant * load;
        });
    add_noise(of, 0.01);
    return of;
  };
  const Identified found = identify({table(0, 0), table(0.2, 0.1)}, of_table, {}, ignore);
  EXPECT_TRUE(found.checks.front().misfit.found);
  EXPECT_GT(found.checks.front().after, 0.02);
}

/// Slow motion with other friction than fast motion.
TEST(Tables, FrictionOfSlowMotionIsCompared) {
  const scenario::Scenario arm = scenario("practical_rigid", "20", 2);
  const auto falling = [](Index joint, double v, double /*load*/) {
    const double coulomb = joint == 0 ? 8 * (1 + std::exp(-std::abs(v) / 0.1)) : 2;
    return 2 * v + (v > 0 ? coulomb : -coulomb);
  };
  // Fast motion for 15 s, and then a twentieth as fast.
  Recording both = table_of_path(
      arm, *arm.model, 30,
      [](Index joint, double t) {
        const double fast = 0.5 * (1 - std::tanh(t - 15)), shift = 0.3 * static_cast<double>(joint);
        return fast * 0.5 * std::sin((1.7 + shift) * t) + 0.4 * std::sin((0.14 + 0.1 * shift) * t);
      },
      falling);
  add_noise(both, 0.002);
  const Parameters without(arm, of_table, false);
  const TableAnswer compared = table_answer({regression(both, without)}, without, *arm.model);
  EXPECT_GT(compared.misfits[0].slow_friction, 1);
  EXPECT_EQ(compared.misfits[1].slow_friction, 0);
  // A fall of friction with speed explains the difference.
  Identified found = identify({both}, of_table, {}, ignore);
  ASSERT_EQ(found.parameters.back().entry.name, "rise shoulder");
  EXPECT_LT(found.parameters.back().value, -4);
  EXPECT_EQ(found.checks[0].misfit.slow_friction, 0);
  found.checks[0].misfit.slow_friction = 2;
  EXPECT_THAT(identify::text(found, "arm"),
              HasSubstr("friction of shoulder is not viscous + Coulomb: slow and fast motion "
                        "differ by"));
}

TEST(Logs, AWrongModelIsCalledWrong) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", 6);
  const auto misfit = [&](const scenario::Scenario& plant) {
    const Identified found = identify({log_of(plant, believed)}, seen_in_tables, {}, ignore);
    return std::ranges::any_of(found.checks, [](const auto& of) { return of.misfit.found; });
  };
  EXPECT_FALSE(misfit(hidden(believed, hidden_truth)));
  scenario::Scenario heavy = hidden(believed, hidden_truth), tilted = heavy, sticky = heavy;
  auto model = std::make_shared<robot::Model>(*heavy.model);
  for (robot::MassProperties& body : model->bodies) body.mass *= 1.2;
  heavy.model = model;
  EXPECT_TRUE(misfit(heavy));
  auto leaning = std::make_shared<robot::Model>(*tilted.model);
  leaning->gravity = 9.81 * Eigen::Vector3d(-std::sin(0.035), 0, -std::cos(0.035));
  tilted.model = leaning;
  EXPECT_TRUE(misfit(tilted));
  sticky.plant.drive.static_friction_Nm = Eigen::Vector2d(6.6, 2);
  sticky.plant.drive.stribeck_velocity_rad_per_s = Eigen::Vector2d(0.05, 0.05);
  EXPECT_TRUE(misfit(sticky));
}

/// Noise of the encoder shakes the arm and lowers its dry friction. The simulated loop has the same
/// noise.
TEST(Logs, IntervalsHoldWithEncoderNoise) {
  scenario::Scenario believed = scenario("practical_rigid", "16", 10);
  believed.plant.encoder.noise_std_rad = 2e-4;
  const Identified found =
      identify({log_of(hidden(believed, hidden_truth), believed)}, seen_in_tables, {}, ignore);
  for (Index i = 0; i < 6; ++i) {
    const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
    EXPECT_NEAR(each.value, hidden_truth[i], 1.5 * each.half_width) << each.entry.name;
  }
  for (const Identified::Check& each : found.checks) EXPECT_FALSE(each.misfit.found) << each.joint;
}

}  // namespace
}  // namespace tachless::identify::misfit_test
