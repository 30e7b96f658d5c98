// Identification of masses and inertias of links by least squares from another logger's tables, and
// the resulting URDF.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <random>

#include "base/failure.h"
#include "identify/least_squares.h"
#include "robot/dynamics.h"
#include "robot/urdf_xml.h"
#include "tests/analysis/identify/hidden_arm.h"
#include "tests/analysis/identify/table_of_motion.h"
#include "tests/support/temporary_directory.h"

namespace tachless::identify::links_test {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using testing::AllOf;
using testing::HasSubstr;

const std::vector<Kind> everything = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::inertia,
                                      Kind::offset};

/// Returns the table of an arm with friction of 0.4 N m s/rad and 0.3 N m and with torque offsets.
Recording motion(const scenario::Scenario& scenario, const robot::Model& arm, double seconds,
                 double seed) {
  return table_of_motion(scenario, arm, seconds, seed, [](Index joint, double v, double /*load*/) {
    return 0.4 * v + (v > 0 ? 0.3 : -0.3) + 0.1 * static_cast<double>(joint);
  });
}

/// Returns a model with another mass, centre and inertia for every link, and with rotors.
robot::Model changed(robot::Model model) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> by(-0.25, 0.25);
  for (robot::MassProperties& body : model.bodies) {
    body.mass *= 1 + by(random);
    body.p_Bcm += 0.1 * Eigen::Vector3d(by(random), by(random), by(random));
    body.I_Bcm *= 1 + by(random);
  }
  model.rotor_inertia = Vector::Constant(model.num_joints, 0.2);
  return model;
}

scenario::Scenario iiwa() {
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/iiwa_point_to_point.yaml");
}

TEST(Links, SaysWhichCombinationsAreDetermined) {
  const scenario::Scenario scenario = iiwa();
  const Recording run = motion(scenario, changed(*scenario.model), 20, 0);
  const Parameters parameters(scenario, {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::inertia});
  const LeastSquares found =
      least_squares({regression(run, parameters)}, parameters, *scenario.model);
  EXPECT_EQ(parameters.size(), 91);
  // An independent program finds as many base parameters of this arm.
  EXPECT_EQ(found.rank, 62);
  // The first joint's rotor and its link turn about one axis. The link's mass has no effect.
  EXPECT_THAT(found.sums[0], HasSubstr("Izz " + scenario.model->bodies[0].link));
  EXPECT_EQ(found.sums[static_cast<std::size_t>(parameters.first(Kind::inertia))], "nothing");
  EXPECT_EQ(found.sums[static_cast<std::size_t>(parameters.first(Kind::viscous))], "");
}

TEST(Links, PredictsTheTorquesOfTheArmThatIsThereByLinksThatCanBe) {
  const scenario::Scenario scenario = iiwa();
  const robot::Model arm = changed(*scenario.model);
  const Recording run = motion(scenario, arm, 20, 0), other = motion(scenario, arm, 5, 0.17);
  const Identified found = identify({run}, everything, {other}, ignore);
  EXPECT_FALSE(found.simulated);
  for (const Identified::Check& each : found.checks) {
    // The filtered signs of the velocity cause the remaining error.
    EXPECT_LT(each.after, 0.01) << each.joint;
    EXPECT_GT(each.before, 5 * each.after) << each.joint;
    EXPECT_FALSE(each.position_error);
  }
  robot::Model model = *scenario.model;
  for (std::size_t i = 0; i < found.links.size(); ++i) {
    static_cast<robot::MassProperties&>(model.bodies[i]) = found.links[i].after;
  }
  EXPECT_TRUE(robot::is_possible(model));
  const Index offset = Parameters(scenario, everything).first(Kind::offset);
  for (Index i = 0; i < 7; ++i) {
    const auto& each = found.parameters[static_cast<std::size_t>(offset + i)];
    EXPECT_NEAR(each.value, 0.1 * static_cast<double>(i), each.half_width)
        << each.entry.name << " +- " << each.half_width;
  }
  const std::string said = identify::text(found, "arm");
  EXPECT_THAT(said, HasSubstr("by least squares, as no controller is known"));
  EXPECT_THAT(said, HasSubstr("combinations are determined"));

  // The written URDF gives this model, whatever was fixed to the links.
  const robot::Model read = robot::model_from_urdf(urdf_of(found, scenario), "written");
  ASSERT_EQ(read.bodies.size(), model.bodies.size());
  for (std::size_t i = 0; i < read.bodies.size(); ++i) {
    EXPECT_NEAR(read.bodies[i].mass, model.bodies[i].mass, 1e-12);
    EXPECT_LT((read.bodies[i].I_Bcm - model.bodies[i].I_Bcm).norm(), 1e-12);
    EXPECT_LT((read.bodies[i].p_Bcm - model.bodies[i].p_Bcm).norm(), 1e-12);
  }
}

/// A payload's inertia from the scenario is known and does not depend on the mass that is found.
TEST(Links, OfAPayloadWithAnInertiaTheMassIsFound) {
  scenario::Scenario scenario = iiwa();
  scenario.plant.payload.inertia_kgm2 = {0.3, 0, 0, 0.3, 0, 0.3};
  scenario.plant.payload.mass_kg = 0.5;
  const Recording run = motion(scenario, scenario::with_payload(scenario, *scenario.model), 10, 0);
  scenario.plant.payload.mass_kg = 0;
  const Identified found =
      identify({run}, {Kind::viscous, Kind::coulomb, Kind::payload, Kind::offset}, {}, ignore);
  const auto& payload = found.parameters[14];
  EXPECT_EQ(payload.entry.name, "payload");
  // The filtered signs of the velocity cause the remaining error.
  EXPECT_NEAR(payload.value, 0.5, 0.01);
}

/// A torque sensor on the link side of the gear measures no rotor, and a wrist's torque is mostly
/// noise. Each rotor is then known to be small, and the model is whole.
TEST(Links, AParameterThatIsNotToldFromZeroIsKnownToBeSmall) {
  const scenario::Scenario scenario = iiwa();
  robot::Model arm = changed(*scenario.model);
  arm.rotor_inertia.setZero();
  Recording run = table_of_motion(
      scenario, arm, 14, 0,
      [](Index /*joint*/, double v, double /*load*/) { return 0.05 * v + (v > 0 ? 0.15 : -0.15); });
  add_noise(run, 0.02);
  const Identified found = identify({run}, everything, {}, ignore);
  int small = 0;
  for (const Identified::Parameter& each : found.parameters) {
    EXPECT_TRUE(each.doubt.empty() || each.in_sum || each.entry.kind == Kind::inertia)
        << each.entry.name << ": " << each.doubt;
    small += each.entry.kind == Kind::rotor && each.is_small() ? 1 : 0;
    EXPECT_TRUE(!each.at_bound || each.value == 0) << each.entry.name;
  }
  EXPECT_GE(small, 3);
  EXPECT_THAT(identify::text(found, "arm"), HasSubstr("small, not told from zero"));
  for (const Identified::Check& each : found.checks) EXPECT_FALSE(each.misfit.found) << each.joint;
}

/// The arm rests for most of the recording and then moves a little. Torques of such a motion tell
/// few numbers of the links, and the URDF's prior tells the others. The fit used it, and the
/// intervals have it too: the model predicts the torques and is whole.
TEST(Links, TheUrdfTellsWhatALittleMotionDoesNot) {
  const scenario::Scenario scenario = iiwa();
  const robot::Model arm = changed(*scenario.model);
  const auto path = [](Index joint, double t) {
    const double size = 0.2 * std::max(0.0, t - 7) / 4, w = 2 + 0.3 * static_cast<double>(joint);
    return size * std::sin(w * t) + 0.1 * static_cast<double>(joint);
  };
  Recording run =
      table_of_path(scenario, arm, 11, path, [](Index joint, double v, double /*load*/) {
        return 0.4 * v + (v > 0 ? 0.3 : v < 0 ? -0.3 : 0) + 0.1 * static_cast<double>(joint);
      });
  add_noise(run, 0.02);
  const Identified found = identify({run}, everything, {}, ignore);
  const std::map<Kind, double> friction = {
      {Kind::rotor, 0.2}, {Kind::viscous, 0.4}, {Kind::coulomb, 0.3}};
  Index by_urdf = 0, held = 0, of_all = 0;
  for (const Identified::Parameter& each : found.parameters) {
    const bool of_link = each.entry.kind == Kind::inertia;
    EXPECT_TRUE(each.doubt.empty() || each.in_sum || of_link) << each.entry.name << each.doubt;
    if (!std::isfinite(each.half_width)) continue;
    double truth = 0.1 * each.entry.joint;
    if (of_link) {
      const auto body = static_cast<std::size_t>(each.entry.joint);
      truth = (inertial_of(arm.bodies[body]) -
               inertial_of(scenario.model->bodies[body]))[each.entry.component];
    } else if (each.entry.kind != Kind::offset) {
      truth = friction.at(each.entry.kind);
    }
    by_urdf += each.by_urdf ? 1 : 0;
    held += std::abs(each.value - truth) <= each.half_width ? 1 : 0;
    ++of_all;
  }
  EXPECT_GT(by_urdf, 20);
  EXPECT_GT(of_all, 40);
  // 95 % of 50 intervals, less three standard deviations.
  EXPECT_GE(static_cast<double>(held), 0.86 * static_cast<double>(of_all));
  EXPECT_THAT(identify::text(found, "arm"), HasSubstr("mainly by the URDF's links"));
}

TEST(Links, OfALogTheLoopIsSimulatedWithThem) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", 2.5);
  scenario::Scenario plant = believed;
  auto arm = std::make_shared<robot::Model>(*believed.model);
  arm->bodies[1].mass *= 1.2;
  plant.model = arm;
  plant.plant.drive.viscous_friction_Nms_per_rad << 2, 1;
  const Identified found = identify({record(believed, plant)},
                                    {Kind::viscous, Kind::coulomb, Kind::inertia}, {}, ignore);
  EXPECT_TRUE(found.simulated);
  EXPECT_NEAR(found.parameters[0].value, 2, 0.02);
  EXPECT_NEAR(found.parameters[1].value, 1, 0.01);
  // The residual is the encoder's: a count of 2 pi / 2^20 is 6e-6 rad.
  for (const Identified::Check& each : found.checks) EXPECT_LT(each.position_error, 4e-6);
}

class Table : public testing::Test {
 protected:
  Recording read(const std::string& rows, const std::string& more = "",
                 const std::string& scenario = "practical_rigid") const {
    std::ofstream(directory_ / "run.csv") << rows;
    std::ofstream(directory_ / "run.yaml")
        << "scenario: " TACHLESS_SOURCE_DIR "/scenarios/" << scenario << ".yaml\ntable: run.csv\n"
        << (more.empty() ? "position_columns: [2, 3]\ntorque_columns: [5, 4]\n" : more);
    return read_table(directory_ / "run.yaml");
  }
  std::string refusal(const std::string& rows, const std::string& more = "") const {
    try {
      read(rows, more);
    } catch (const base::Failure& failure) {
      return failure.what();
    }
    return "nothing";
  }
  static std::string rows(int count, const std::string& last = "") {
    std::string text = "time; q1; q2; tau2; tau1\n";
    for (int k = 0; k < count; ++k) {
      // Times of a logger on a busy machine.
      const double t = 5 + 0.01 * k + (k % 3 == 1 ? 0.002 : 0);
      text += fmt::format("{:.6f}; {:.9f}; {:.9f}; 2; {}\n", t, 30 * t, -t, 7 * t);
    }
    return text + last;
  }

  TemporaryDirectory directory_;
};

TEST_F(Table, IsPutOnAnEvenGridInOurUnits) {
  const Recording run = read(rows(400),
                             "position_columns: [2, 3]\ntorque_columns: [5, 4]\n"
                             "position_scale: [0.017453292519943295, 1]\ntorque_scale: 2\n");
  EXPECT_FALSE(run.controlled);
  EXPECT_NEAR(run.scenario.loop.period_s, 0.01, 1e-9);
  ASSERT_GT(run.num_ticks(), 390);
  // Interpolation keeps straight lines.
  for (const Index k : {0, 1, 200}) {
    const double t = 5 + run.scenario.loop.period_s * static_cast<double>(k);
    EXPECT_NEAR(run.q(k, 0), t * M_PI / 6, 1e-8);
    EXPECT_NEAR(run.q(k, 1), -t, 1e-8);
    EXPECT_NEAR(run.tau(k, 0), 14 * t, 1e-8);
    EXPECT_NEAR(run.tau(k, 1), 4, 1e-12);
  }
}

TEST_F(Table, HasTheTorqueThatTheArmAdds) {
  EXPECT_EQ(read(rows(400)).own.size(), 0);
  const Recording run = read(rows(400),
                             "position_columns: [2, 3, 2, 3, 2, 3, 2]\n"
                             "torque_columns: [5, 4, 5, 4, 5, 4, 5]\n",
                             "fr3");
  ASSERT_EQ(run.own.rows(), run.num_ticks());
  const Vector gravity = robot::gravity_torque(*run.scenario.model, run.q.row(9).transpose());
  EXPECT_EQ(Vector(run.own.row(9).transpose()), gravity);
}

TEST_F(Table, MayHaveTextInOtherColumns) {
  std::string text = "motion time q1 q2 tau1 tau2\n";
  for (int k = 0; k < 400; ++k) text += fmt::format("first {} {} 2 3 4\n", 0.01 * k, 0.1 * k);
  const Recording run =
      read(text, "time_column: 2\nposition_columns: [3, 4]\ntorque_columns: [5, 6]\n");
  ASSERT_GT(run.num_ticks(), 390);
  EXPECT_NEAR(run.q(200, 0), 20, 1e-9);  // the numbers of the table lie on a line
}

TEST_F(Table, HasColumnsByNameAndItsOwnUnitOfTime) {
  std::string text = "stamp,tau2,q1,q2,tau1\n";
  for (int k = 0; k < 400; ++k) text += fmt::format("{},3,{},2,1\n", 10 * k, 0.1 * k);
  const std::string columns =
      "position_columns: [q1, q2]\ntorque_columns: [tau1, 2]\ntime_column: stamp\n";
  EXPECT_THAT(refusal(text, columns), HasSubstr("time_scale: 0.001 for milliseconds"));
  const Recording run = read(text, columns + "time_scale: 0.001\ntime_offset: 7\n");
  EXPECT_NEAR(run.scenario.loop.period_s, 0.01, 1e-9);
  EXPECT_NEAR(run.q(200, 0), 20, 1e-9);
  EXPECT_EQ(run.tau(200, 0), 1);
  EXPECT_EQ(run.tau(200, 1), 3);
}

/// One row would change every parameter: 1000 N m, half a radian.
TEST_F(Table, IsRefusedWithTheLineOfASpike) {
  const auto made = [](int line, double q, double tau) {
    std::string text = "t,q1,q2,tau1,tau2\n";
    for (int k = 0; k < 1000; ++k) {
      const double t = 0.01 * k, v = std::cos(3 * t);
      const bool here = k + 2 == line;
      // Torques jump by 20 N m at each reversal.
      text += fmt::format("{},{},{},{},{}\n", t, std::sin(3 * t) + (here ? q : 0), std::cos(t),
                          40 * std::sin(3 * t) + (v > 0 ? 10 : -10) + (here ? tau : 0), 5 * v);
    }
    return text;
  };
  const std::string columns = "position_columns: [q1, q2]\ntorque_columns: [tau1, tau2]\n";
  EXPECT_EQ(refusal(made(0, 0, 0), columns), "nothing");
  EXPECT_THAT(refusal(made(500, 0, 1000), columns), HasSubstr("run.csv:500: "));
  EXPECT_THAT(refusal(made(500, 0, 1000), columns),
              HasSubstr("in column 4 is off by 999 from the rows around it; correct or delete"));
  EXPECT_THAT(refusal(made(731, -0.5, 0), columns), HasSubstr("run.csv:731: "));
  EXPECT_THAT(refusal(made(731, 0.05, 0), columns), HasSubstr("in column 2 is off by 0.05"));
}

TEST_F(Table, IsRefusedWithTheLineAndWhatIsAllowed) {
  EXPECT_THAT(refusal(rows(400), "position_columns: [2, 3]\ntorque_columns: [5, 6]\n"),
              HasSubstr("column 6 is asked for; allowed: 1 to 5"));
  EXPECT_THAT(
      refusal(rows(400), "time_column: 9\nposition_columns: [2, 3]\ntorque_columns: [5, 4]\n"),
      HasSubstr("column 9 is asked for; allowed: 1 to 5"));
  // A row with an empty field would shift the following columns.
  for (const char* row : {"9.5; 1; 2\n", "9.5; ; 1; 2; 3\n", "; 9.5; 1; 2; 3\n",
                          "9.5,, 1; 2; 3; 4\n", "9.5; 1; 2; 3; 4; 5\n"}) {
    EXPECT_THAT(refusal(rows(400, row)), HasSubstr("run.csv:402: ")) << row;
  }
  EXPECT_THAT(refusal(rows(400, "9; 1; 2; 3; 4;\r\n")), "nothing") << "nothing is behind it";
  EXPECT_THAT(refusal(rows(400, "9.5; 1; nan; 2; 2\n")), HasSubstr("\"nan\" in column \"q2\""));
  EXPECT_THAT(refusal(rows(400, "1e308; 1; 2; 3; 4\n")), HasSubstr("cut the table there"));
  EXPECT_THAT(refusal(rows(400, "5; 1; 2; 3; 4\n")), HasSubstr("allowed: increasing times"));
  EXPECT_THAT(refusal(rows(400, "15; 1; 2; 3; 4\n")), HasSubstr("cut the table there"));
  EXPECT_THAT(refusal(rows(100)), HasSubstr("at least 2 s"));
  EXPECT_THAT(refusal(rows(1)), HasSubstr("1 rows of numbers"));
  EXPECT_THAT(refusal("a, b\n"), HasSubstr("no column for the time"));
  EXPECT_THAT(refusal(rows(400), "position_columns: [2, 3]\n"), HasSubstr("torque_columns"));
  EXPECT_THAT(refusal(rows(400), "position_columns: [2, 0]\ntorque_columns: [5, 4]\n"),
              HasSubstr("position_columns"));
  EXPECT_THAT(refusal(rows(400), "positions: [2, 3]\n"), HasSubstr("positions"));
}

}  // namespace
}  // namespace tachless::identify::links_test
