#include "controller/registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <sstream>

#include "base/failure.h"
#include "controller/law/loria_ortega_matrix.h"
#include "controller/law/loria_ortega_rigid.h"
#include "robot/dynamics.h"

namespace tachless::controller {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

Vector pair(double x, double y) {
  Vector v(2);
  v << x, y;
  return v;
}

std::string two_link_urdf() {
  std::ifstream file(std::string(TACHLESS_SOURCE_DIR) + "/scenarios/robots/two_link.urdf");
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

scenario::Scenario rigid_scenario() {
  scenario::Scenario scenario;
  scenario.source = "arm.yaml";
  scenario.where = {{"controller.law", "arm.yaml:20"},
                    {"controller.gains", "arm.yaml:21"},
                    {"controller.gains.kp", "arm.yaml:22"}};
  scenario.num_joints = 2;
  scenario.robot.urdf_text = two_link_urdf();
  scenario.robot.urdf_path = "two_link.urdf";
  scenario.model = std::make_shared<const robot::Model>(
      robot::model_from_urdf(scenario.robot.urdf_text, scenario.robot.urdf_path));
  scenario.robot.rigid_rotor_inertia_kgm2 = pair(0, 0);
  scenario.reference =
      reference::trajectory::Sinusoid{{pair(1, 1), pair(1, 1), pair(0, 0)}, pair(0, 0)};
  scenario.controller.law = "loria_ortega_rigid";
  scenario.controller.gains = {
      {"kp", pair(5, 6)}, {"kd", pair(7, 8)}, {"a", pair(9, 10)}, {"b", pair(11, 12)}};
  return scenario;
}

scenario::Scenario flexible_scenario(const std::string& law) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.robot.flexible = plant::FlexibleDrive{pair(1e4, 2e4), pair(0.1, 0.2), pair(0, 0), {}};
  scenario.controller.law = law;
  scenario.controller.gains.clear();
  for (const std::string_view gain : parameter_names(law_facts(law))) {
    scenario.controller.gains[std::string(gain)] = pair(3, 3);
  }
  for (const char* below_3 : {"linear", "load_joint"}) scenario.controller.gains.erase(below_3);
  scenario.plant.drive.torque_limit_Nm = pair(100, 100);
  return scenario;
}

/// Returns the line with which a scenario is refused.
std::string refusal(const scenario::Scenario& scenario) {
  try {
    scenario_law(scenario);
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    const std::string text = failure.what();
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    return text;
  }
  return "accepted";
}

TEST(Registry, MakesEveryLawByItsName) {
  for (const std::string_view name : law_names()) {
    scenario::Scenario scenario = flexible_scenario(std::string(name));
    scenario.reference = reference::trajectory::Hold{pair(0, 0)};
    const ScenarioLaw law = scenario_law(scenario);
    EXPECT_EQ(law->name(), name);
  }
}

TEST(Registry, RefusesABoundedLawWithoutTorqueLimits) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.controller.law = "loria_ortega_bounded";
  scenario.plant.drive.torque_limit_Nm = pair(100, std::numeric_limits<double>::infinity());
  EXPECT_THAT(refusal(scenario), HasSubstr("plant.drive.torque_limit_Nm"));
  scenario.plant.drive.torque_limit_Nm = pair(100, 100);
  EXPECT_EQ(scenario_law(scenario)->name(), "loria_ortega_bounded");
}

TEST(Registry, KnowsWhatEachLawIsFedWith) {
  EXPECT_EQ(law_facts("loria_ortega_rigid").measurement, "POSITION");
  EXPECT_EQ(law_facts("kelly_regulation").measurement, "POSITION");
  EXPECT_EQ(law_facts("berghuis_nijmeijer").measurement, "POSITION");
  EXPECT_EQ(law_facts("nicosia_tomei").measurement, "POSITION");
  EXPECT_EQ(law_facts("zhang_dawson").measurement, "POSITION");
  EXPECT_EQ(law_facts("kelly_flexible").measurement, "MOTOR_POSITION");
  EXPECT_EQ(law_facts("flexible_motor").measurement, "MOTOR_POSITION");
  EXPECT_EQ(law_facts("flexible_position").measurement, "BOTH_POSITIONS");
  EXPECT_EQ(law_facts("loria_ortega_flexible").measurement, "LINK_STATE");
  EXPECT_EQ(law_facts("wen_bayard").measurement, "STATE");
  EXPECT_EQ(law_facts("slotine_li").measurement, "STATE");
  EXPECT_EQ(law_facts("slotine_li_flexible").measurement, "STATE");
  EXPECT_EQ(law_facts("motor_pd_feedforward").measurement, "STATE");
  for (const char* law : {"numerical_difference", "kalman_velocity", "robust_differentiator"}) {
    EXPECT_EQ(law_facts(law).measurement, "POSITION");
  }
  EXPECT_EQ(law_facts("computed_torque").measurement, "STATE");
  EXPECT_EQ(law_facts("pd_gravity").measurement, "STATE");
}

TEST(Registry, NamesFiltersAndGains) {
  EXPECT_EQ(messages::text_of(law_facts("loria_ortega_rigid").signals), "error:rad,nu:rad/s");
  EXPECT_EQ(messages::text_of(law_facts("loria_ortega_flexible").signals),
            "error_1:rad,nu_1:rad/s,error_2:rad,nu_2:rad/s");
  EXPECT_EQ(messages::text_of(law_facts("slotine_li").signals), "error:rad,edot:rad/s");
  EXPECT_THAT(parameter_names(law_facts("loria_ortega_flexible")),
              ElementsAre("kp1", "kd1", "a1", "b1", "kp2", "kd2", "a2", "b2"));
}

TEST(Registry, GivesTheLawItsGainsAndSampling) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.loop.period_s = 2e-3;
  scenario.loop.command_delay = 1;
  scenario.plant.encoder.latency_ticks = 2;
  scenario.controller.filter = law::Discretisation::tustin;
  scenario.controller.filter_start = law::FilterStart::zero;
  scenario.controller.feedforward_lead = controller::FeedforwardLead::half_tick_plus_delay;
  const law::Settings settings = law_settings(scenario);
  EXPECT_EQ(settings.period_s, 2e-3);
  EXPECT_EQ(settings.filter, law::Discretisation::tustin);
  EXPECT_EQ(settings.filter_start, law::FilterStart::zero);
  EXPECT_EQ(settings.feedforward_lead_s, 3.5 * 2e-3);

  const messages::PositionMeasurement measured{pair(0.3, -0.4)};
  const Vector zero = pair(0, 0);
  const messages::ReferencePoint ref{zero, pair(1, 2), pair(3, 4), pair(5, 6), pair(7, 8)};
  const law::LoriaOrtegaRigid expected(
      rigid_model(scenario), {pair(5, 6), pair(7, 8), pair(9, 10), pair(11, 12)}, settings);
  const ScenarioLaw law = scenario_law(scenario);
  const Vector tau = law->step(0, measured, ref).command.tau;
  EXPECT_EQ(tau, expected.step(expected.start(measured, ref), measured, ref).command.tau);
}

TEST(Registry, TellsTheLawHowFarTheEncodersPositionsAreOff) {
  scenario::Scenario scenario = rigid_scenario();
  EXPECT_EQ(law_settings(scenario).position_std, pair(0, 0));
  scenario.plant.encoder.resolution_bits = pair(16, 16);
  const double count = 2 * 3.14159265358979 / 65536;
  EXPECT_NEAR(law_settings(scenario).position_std[0], count / std::sqrt(12), 1e-15);
  scenario.plant.encoder.noise_std_rad = 1e-4;
  EXPECT_NEAR(law_settings(scenario).position_std[1], std::sqrt(count * count / 12 + 1e-8), 1e-15);
}

TEST(Registry, RefusesAKalmanFilterThatKnowsNoMeasurementNoise) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.controller.law = "kalman_velocity";
  scenario.controller.gains = {{"kp", pair(5, 6)}, {"kd", pair(7, 8)}};
  scenario.controller.gains["process_noise"] = pair(1, 1);
  scenario.controller.gains["order"] = pair(2, 2);
  EXPECT_THAT(refusal(scenario),
              AllOf(HasSubstr("arm.yaml:21: controller.gains: measurement_noise is missing"),
                    HasSubstr("plant.encoder.resolution_bits")));
  scenario.plant.encoder.resolution_bits = pair(16, 16);
  EXPECT_EQ(refusal(scenario), "accepted");
  scenario.plant.encoder.resolution_bits.reset();
  scenario.controller.gains["measurement_noise"] = pair(1e-5, 1e-5);
  EXPECT_EQ(refusal(scenario), "accepted");
}

TEST(Registry, ReadsMatricesByRowsOrByTheirDiagonalAndRefusesOthers) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.controller.law = "loria_ortega_matrix";
  scenario.controller.gains["a"] = scenario.controller.gains["b"] = pair(300, 300);
  const auto kp = [&](const Eigen::VectorXd& value) {
    scenario.controller.gains["kp"] = value;
    return gains_of<law::MatrixGains>(scenario, law_facts(scenario.controller.law)).kp;
  };
  EXPECT_EQ(kp(pair(5, 6)), Matrix(pair(5, 6).asDiagonal()));
  EXPECT_EQ(kp(Eigen::Vector4d(5, 1, 1, 6))(1, 0), 1);
  for (const Eigen::Vector4d& refused : {Eigen::Vector4d(5, 1, 2, 6), {5, 9, 9, 6}}) {
    scenario.controller.gains["kp"] = refused;
    EXPECT_THAT(refusal(scenario), AllOf(HasSubstr("arm.yaml:22: controller.gains.kp"),
                                         HasSubstr("symmetric and positive definite")));
  }
}

TEST(Registry, RefusesFrictionFedForwardThroughSprings) {
  scenario::Scenario scenario = flexible_scenario("loria_ortega_flexible");
  scenario.controller.friction = {pair(1, 1), pair(0, 0), pair(1, 1)};
  EXPECT_THAT(refusal(scenario), HasSubstr("controller.friction: given, and the joints are flex"));
}

TEST(Registry, AddsRotorInertiaForRigidLawsOnlyAndTakesTheScenariosGravity) {
  scenario::Scenario scenario = flexible_scenario("loria_ortega_rigid");
  robot::Model on_the_moon = *scenario.model;
  on_the_moon.gravity = {0, 0, -1.62};
  scenario.model = std::make_shared<const robot::Model>(on_the_moon);
  const Vector q = pair(0.4, 0.7);
  const robot::Model rigid = rigid_model(scenario);
  const law::FlexibleRobot flexible = flexible_robot(scenario);
  const Matrix difference = robot::mass_matrix(rigid, q) - robot::mass_matrix(flexible.links, q);
  // M_l + J less M_l: one rounding of entries of up to 10.
  EXPECT_NEAR(difference(0, 0), 0.1, 4e-15);
  EXPECT_NEAR(difference(1, 1), 0.2, 4e-15);
  EXPECT_EQ(difference(0, 1), 0);
  EXPECT_EQ(flexible.stiffness, pair(1e4, 2e4));
  EXPECT_EQ(flexible.rotor_inertia, pair(0.1, 0.2));
  EXPECT_EQ(rigid.gravity, Eigen::Vector3d(0, 0, -1.62));
  EXPECT_EQ(flexible.links.gravity, Eigen::Vector3d(0, 0, -1.62));

  scenario = rigid_scenario();
  scenario.robot.rigid_rotor_inertia_kgm2 = pair(0.5, 0.6);
  EXPECT_EQ(rigid_model(scenario).rotor_inertia, pair(0.5, 0.6));
}

TEST(Registry, DoesNotTellTheControllerOfThePayload) {
  scenario::Scenario loaded = rigid_scenario();
  loaded.plant.payload.mass_kg = 3;
  const Vector q = pair(0.4, 0.7);
  EXPECT_EQ(robot::mass_matrix(rigid_model(loaded), q),
            robot::mass_matrix(rigid_model(rigid_scenario()), q));
}

TEST(Registry, RefusesAnUnknownLawNamingTheNearest) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.controller.law = "loria_ortega_ridgid";
  EXPECT_THAT(refusal(scenario),
              AllOf(HasSubstr("arm.yaml:20: controller.law:"), HasSubstr("loria_ortega_ridgid"),
                    HasSubstr("did you mean loria_ortega_rigid?"), HasSubstr("wen_bayard")));
  scenario.controller.law = "loria";
  EXPECT_THAT(refusal(scenario), HasSubstr("did you mean loria_ortega_rigid?"));
  scenario.controller.law = "nothing";
  EXPECT_THAT(refusal(scenario),
              AllOf(HasSubstr("no law \"nothing\"; Allowed"), Not(HasSubstr("did you mean"))));
  EXPECT_THROW(law_facts("nothing"), base::Failure);
}

TEST(Registry, RefusesGainsThatAreMissingUnknownOrOutOfRange) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.controller.gains.erase("kd");
  EXPECT_THAT(refusal(scenario), AllOf(HasSubstr("arm.yaml:21: controller.gains:"),
                                       HasSubstr("kd is missing"), HasSubstr("kp, kd, a, b")));

  scenario = rigid_scenario();
  scenario.controller.gains["kpp"] = pair(1, 1);
  EXPECT_THAT(refusal(scenario),
              AllOf(HasSubstr("controller.gains.kpp:"), HasSubstr("did you mean kp?")));

  for (const double bad : {0.0, -5.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (const char* gain : {"kp", "kd", "a", "b"}) {
      scenario = rigid_scenario();
      scenario.controller.gains[gain][1] = bad;
      EXPECT_THAT(refusal(scenario),
                  AllOf(HasSubstr("controller.gains." + std::string(gain)), HasSubstr("each > 0")));
    }
  }

  scenario = rigid_scenario();
  scenario.controller.gains["kp"] = Vector::Ones(3);
  EXPECT_THAT(refusal(scenario), AllOf(HasSubstr("arm.yaml:22: controller.gains.kp:"),
                                       HasSubstr("3 entries; needed: one per joint, 2")));
}

TEST(Registry, RefusesGainsOfOtherLawsAndNamesItsOwnWithTheirUnits) {
  scenario::Scenario scenario = rigid_scenario();
  scenario.controller.law = "computed_torque";
  EXPECT_THAT(refusal(scenario), AllOf(HasSubstr("controller.gains.a: computed_torque has no such"),
                                       HasSubstr("kp [1/s^2]")));
}

TEST(Registry, RefusesFlexibleLawsOnRigidJoints) {
  for (const char* law :
       {"loria_ortega_flexible", "kelly_flexible", "slotine_li_flexible", "motor_pd_feedforward"}) {
    scenario::Scenario scenario = flexible_scenario(law);
    scenario.reference = reference::trajectory::Hold{pair(0, 0)};
    EXPECT_EQ(refusal(scenario), "accepted");
    scenario.robot.flexible.reset();
    EXPECT_THAT(refusal(scenario),
                AllOf(HasSubstr("arm.yaml:20: controller.law:"), HasSubstr("flexible"),
                      HasSubstr("stiffness_Nm_per_rad: [10000, 10000]"),
                      HasSubstr("allowed on rigid joints: berghuis_nijmeijer")));
  }
}

TEST(Registry, RefusesRegulatorsWithAMovingReference) {
  for (const char* law : {"kelly_regulation", "kelly_flexible"}) {
    EXPECT_THAT(refusal(flexible_scenario(law)),
                AllOf(HasSubstr("controller.law"), HasSubstr("allowed reference: hold")));
  }
}

TEST(Registry, RefusesALeadThatTheLawDoesNotHave) {
  scenario::Scenario scenario = flexible_scenario("loria_ortega_flexible");
  scenario.controller.feedforward_lead = controller::FeedforwardLead::half_tick_plus_delay;
  EXPECT_THAT(refusal(scenario),
              AllOf(HasSubstr("controller.feedforward_lead"), HasSubstr("allowed: none")));
}

TEST(Registry, RefusesLawsWhoseEncodersTheRobotDoesNotHave) {
  using plant::EncoderSide;
  const auto with_side = [](const char* law, EncoderSide side) {
    scenario::Scenario scenario = flexible_scenario(law);
    scenario.reference = reference::trajectory::Hold{pair(0, 0)};
    scenario.plant.encoder.side = side;
    return refusal(scenario);
  };
  EXPECT_EQ(with_side("loria_ortega_rigid", EncoderSide::link), "accepted");
  EXPECT_EQ(with_side("kelly_flexible", EncoderSide::motor), "accepted");
  EXPECT_THAT(with_side("loria_ortega_rigid", EncoderSide::motor),
              AllOf(HasSubstr("plant.encoder.side: motor"), HasSubstr("both or link")));
  EXPECT_THAT(with_side("kelly_flexible", EncoderSide::link), HasSubstr("both or motor"));
  EXPECT_THAT(with_side("loria_ortega_flexible", EncoderSide::link), HasSubstr(": both"));
  EXPECT_THAT(with_side("wen_bayard", EncoderSide::motor), HasSubstr(": both"));
}

struct MixedGains {
  Vector kp;
  Vector friction;
  double cutoff_hz = 50;
  int order = 2;
  static constexpr std::tuple keys{
      base::Key{"kp", &MixedGains::kp, "N m/rad"}.in(base::positive),
      base::Key{"friction", &MixedGains::friction, "N m"}.in(base::not_negative).by_default(0),
      base::Key{"cutoff_hz", &MixedGains::cutoff_hz, "Hz"}.in(base::positive).by_default(),
      base::Key{"order", &MixedGains::order}.in({1, 9}).by_default()};
};

LawFacts mixed_facts() {
  LawFacts facts;
  facts.name = "mixed";
  base::for_each_key<MixedGains>([&]<class Member>(const base::Key<MixedGains, Member>& key) {
    facts.parameters.push_back({key.name, key.unit, key.meaning, base::shape_of<Member>, key.range,
                                base::allowed_text(key), key.fallback == base::Default::required});
  });
  return facts;
}

TEST(Registry, ReadsParametersPerJointNumbersAndCountsWithTheirDefaults) {
  scenario::Scenario scenario = rigid_scenario();
  MixedGains gains = gains_of<MixedGains>(scenario, mixed_facts());
  EXPECT_EQ(gains.kp, pair(5, 6));
  EXPECT_EQ(gains.friction, pair(0, 0));
  EXPECT_EQ(gains.cutoff_hz, 50);
  EXPECT_EQ(gains.order, 2);
  scenario.controller.gains["friction"] = pair(0, 3);
  scenario.controller.gains["cutoff_hz"] = pair(20, 20);
  scenario.controller.gains["order"] = pair(3, 3);
  gains = gains_of<MixedGains>(scenario, mixed_facts());
  EXPECT_EQ(gains.friction, pair(0, 3));
  EXPECT_EQ(gains.cutoff_hz, 20);
  EXPECT_EQ(gains.order, 3);
}

TEST(Registry, RefusesAnotherCountAndNoOtherParameter) {
  scenario::Scenario before = rigid_scenario();
  before.controller.gains["order"] = pair(3, 3);
  scenario::Scenario after = before;
  after.controller.gains["kp"] = pair(1, 2);
  after.controller.gains["cutoff_hz"] = pair(20, 20);
  EXPECT_NO_THROW(require_same_counts(before, after, mixed_facts()));
  after.controller.gains["order"] = pair(2, 2);
  try {
    require_same_counts(before, after, mixed_facts());
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(),
                AllOf(HasSubstr("controller.gains.order: a count"), HasSubstr("as the run began")));
  }
}

TEST(Registry, RefusesParametersOutOfTheirShapeOrRange) {
  const auto refused = [](const std::string& name, const Vector& value) -> std::string {
    scenario::Scenario scenario = rigid_scenario();
    scenario.controller.gains[name] = value;
    try {
      gains_of<MixedGains>(scenario, mixed_facts());
      return "accepted";
    } catch (const base::Failure& failure) {
      return failure.what();
    }
  };
  EXPECT_THAT(refused("friction", pair(0, -1)), HasSubstr("each >= 0"));
  EXPECT_THAT(refused("cutoff_hz", pair(20, 30)), HasSubstr("a finite number > 0"));
  EXPECT_THAT(refused("order", pair(2.5, 2.5)), HasSubstr("a whole number in [1, 9]"));
  EXPECT_THAT(refused("order", pair(10, 10)), HasSubstr("a whole number in [1, 9]"));
}

}  // namespace
}  // namespace tachless::controller
