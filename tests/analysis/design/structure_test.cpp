// The choice between structures of gains, uncertain plants, and makers' stiffness.

#include "design/structure.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "design/far_start.h"
#include "design/maker_stiffness.h"
#include "design/uncertainty.h"
#include "scenario/scenario.h"

namespace tachless::design {
namespace {

using ::testing::HasSubstr;

std::string file_text(const std::string& name) {
  std::ifstream file(TACHLESS_SOURCE_DIR "/scenarios/robots/" + name);
  return {std::istreambuf_iterator<char>(file), {}};
}

robot::Model model_of(const std::string& name) {
  return robot::model_from_urdf(file_text(name), name);
}

/// Returns the URDF with this share of its effort limits.
std::string with_effort(std::string urdf, double share) {
  constexpr std::string_view key = "effort=\"";
  for (std::size_t at = 0; (at = urdf.find(key, at)) != std::string::npos;) {
    at += key.size();
    const std::size_t end = urdf.find('"', at);
    urdf.replace(at, end - at, fmt::format("{:g}", share * std::stod(urdf.substr(at, end - at))));
  }
  return urdf;
}

Comparison compared(const std::string& urdf, const DesignGoal& goal, double effort = 1) {
  const std::string text = with_effort(file_text(urdf), effort);
  const robot::Model model = robot::model_from_urdf(text, urdf);
  return compare(
      [&](Structure structure) {
        return scenario::parse_scenario(
            scenario::urdf_scenario(model, {"bare", "robot.urdf"}), text, "bare",
            {"controller.gains={}", "controller.law=" + std::string(law_of(structure))});
      },
      goal, linear::no_progress);
}

/// The two-link arm settles four times as fast with scheduled gains at the same bandwidth.
TEST(Structure, ScheduledGainsAreTakenWhereTheySettleFaster) {
  const Comparison both = compared("two_link.urdf", {});
  ASSERT_EQ(both.candidates.size(), 2U);
  ASSERT_TRUE(both.candidates[0].design && both.candidates[1].design);
  const double diagonal = both.candidates[0].design->loop.modes.settling_s;
  const double scheduled = both.candidates[1].design->loop.modes.settling_s;
  EXPECT_EQ(both.chosen, diagonal > 1.1 * scheduled ? 1U : 0U) << both.reason;
  EXPECT_FALSE(both.reason.empty());
  // Without a bandwidth in the goal, the scheduled gains have the default one: w of two equal
  // poles.
  EXPECT_LE(both.candidates[1].design->gains.at("w")[0], 2 * 3.1416 * default_bandwidth_hz * 1.001);
}

/// A UR5e with 42 % of its torque can follow its motion. From 0.3 rad beside, it tumbles with
/// gains of 10 Hz.
TEST(Structure, DefaultBandwidthLetsAWeakArmComeBackFromAFarStart) {
  const Comparison weak = compared("ur5e.urdf", {}, 0.42);
  ASSERT_EQ(weak.chosen, 1U) << weak.reason;
  const Candidate& scheduled = weak.candidates[1];
  EXPECT_LE(scheduled.design->gains.at("w")[0], 2 * 3.1416 * 8);
  EXPECT_THAT(scheduled.design->warnings, ::testing::Contains(HasSubstr("Hz in place of 10")));
  EXPECT_TRUE(returns_from_beside(scheduled.scenario, *scheduled.design));
}

/// Returns a design whose gain `w` is the bandwidth.
Design design_of(double hz) {
  Design design;
  design.gains["w"] = Vector::Constant(1, hz);
  return design;
}

/// A design of a smaller bandwidth that fails leaves the usual one, with a warning.
TEST(Structure, KeepsTheUsualBandwidthWhereASmallerOneHasNoGains) {
  int complete = 0;
  const Design found = within_default_bandwidth(
      [&](double hz, const Suits& suits) {
        if (hz < 0.7 * default_bandwidth_hz) {
          throw base::Failure(base::ExitCode::check_said_no, "no gains of {} Hz", hz);
        }
        complete += suits && !suits(design_of(hz)) ? 0 : 1;
        return design_of(hz);
      },
      [](const Design&) { return false; });
  EXPECT_EQ(found.gains.at("w")[0], default_bandwidth_hz);
  EXPECT_EQ(complete, 1);  // the usual one, after the smaller ones were refused
  EXPECT_THAT(found.warnings, ::testing::ElementsAre(HasSubstr("from 10 down to 8 Hz")));
}

/// Gains that do not suit are not judged over the joints' range; those of the first bandwidth that
/// suits are.
TEST(Structure, CompletesTheFirstDesignThatComesBack) {
  std::vector<double> complete;
  const Design found = within_default_bandwidth(
      [&](double hz, const Suits& suits) {
        if (!suits || suits(design_of(hz))) complete.push_back(hz);
        return design_of(hz);
      },
      [](const Design& design) { return design.gains.at("w")[0] < 7; });
  EXPECT_NEAR(found.gains.at("w")[0], 6.4, 1e-9);
  EXPECT_THAT(complete, ::testing::ElementsAre(::testing::DoubleNear(6.4, 1e-9)));
  EXPECT_THAT(found.warnings, ::testing::ElementsAre(HasSubstr("6.4 Hz in place of 10")));
}

TEST(Structure, RefusesWhereNoStructureHasGains) {
  DesignGoal goal;
  goal.count_Nm = 1e-9;  // no gain has so little torque per encoder count
  try {
    (void)compared("two_link.urdf", goal);
    ADD_FAILURE() << "gains were found";
  } catch (const base::Failure& refused) {
    EXPECT_EQ(refused.code(), base::ExitCode::check_said_no);
    EXPECT_THAT(refused.what(), HasSubstr("no gains were found"));
  }
}

TEST(MakerStiffness, IsThatOfTheArmByItsJoints) {
  const auto ur5e = maker_stiffness(model_of("ur5e.urdf"));
  ASSERT_TRUE(ur5e);
  EXPECT_EQ(ur5e->N_m_per_rad[0], 900);
  EXPECT_EQ(ur5e->N_m_per_rad[5], 500);
  const auto panda = maker_stiffness(model_of("panda.urdf"));
  ASSERT_TRUE(panda);
  EXPECT_EQ(panda->N_m_per_rad[6], 2000);
  EXPECT_EQ(panda->N_m_per_rad[7], 0);  // the finger
  robot::Model iiwa = model_of("iiwa7.urdf");
  EXPECT_FALSE(maker_stiffness(iiwa));  // its joints have no name of the maker's
  for (std::string& name : iiwa.joint_names) name = "iiwa_joint_" + name.substr(5);
  ASSERT_TRUE(maker_stiffness(iiwa));
  EXPECT_EQ(maker_stiffness(iiwa)->N_m_per_rad, Vector::Constant(7, 1000));
  EXPECT_FALSE(maker_stiffness(model_of("xarm7.urdf")));  // joint1 … joint7, but other efforts
  EXPECT_FALSE(maker_stiffness(model_of("two_link.urdf")));
}

TEST(Uncertainty, IsReadAsTyped) {
  const Uncertainty read = parse_uncertainty("links=20%,rotors=0.05,delay=1");
  EXPECT_EQ(read.links, 0.2);
  EXPECT_EQ(read.rotors, 0);
  ASSERT_EQ(read.rotors_kgm2.size(), 1);
  EXPECT_EQ(read.rotors_kgm2[0], 0.05);
  EXPECT_EQ(read.delay, 1);
  EXPECT_EQ(parse_uncertainty("rotors=30%").rotors, 0.3);
  const Vector each = parse_uncertainty("rotors=0.05/0/2e-3,delay=1").rotors_kgm2;
  EXPECT_EQ(each, Eigen::Vector3d(0.05, 0, 2e-3));
  for (const char* wrong :
       {"", "links", "links=20", "links=120%", "links=-5%", "delay=1.5", "delay=5%", "mass=5%",
        "links=20%,,delay=1", "links=x%", "rotors=0.1/", "rotors=0.1/-1", "rotors=1/20%"}) {
    EXPECT_THROW((void)parse_uncertainty(wrong), base::Failure) << wrong;
  }
}

TEST(Uncertainty, PlantsAreWithinTheBoundsAndReachThem) {
  const robot::Model nominal = model_of("ur5e.urdf");
  const std::vector<UncertainPlant> plants =
      uncertain_plants(nominal, parse_uncertainty("links=20%,rotors=0.05,delay=1"));
  double least = 1, most = 1, heaviest = 0;
  int late = 0;
  for (const UncertainPlant& plant : plants) {
    for (std::size_t i = 0; i < nominal.bodies.size(); ++i) {
      const double ratio = plant.model.bodies[i].mass / nominal.bodies[i].mass;
      least = std::min(least, ratio);
      most = std::max(most, ratio);
    }
    EXPECT_GE(plant.model.rotor_inertia.minCoeff(), 0);
    heaviest = std::max(heaviest, plant.model.rotor_inertia.maxCoeff());
    late += plant.more_delay;
  }
  EXPECT_DOUBLE_EQ(least, 0.8);
  EXPECT_DOUBLE_EQ(most, 1.2);
  EXPECT_DOUBLE_EQ(heaviest, 0.05);
  EXPECT_GT(late, 1);
  EXPECT_EQ(uncertain_plants(nominal, parse_uncertainty("delay=2")).size(), 1U);
}

TEST(Uncertainty, RotorsOfEachJointHaveTheirOwnInterval) {
  robot::Model nominal = model_of("two_link.urdf");
  nominal.rotor_inertia = Eigen::Vector2d(1, 0.1);
  Vector least = Eigen::Vector2d(9, 9), most = Eigen::Vector2d(0, 0);
  for (const UncertainPlant& plant :
       uncertain_plants(nominal, parse_uncertainty("rotors=0.2/0.05"))) {
    least = least.cwiseMin(plant.model.rotor_inertia);
    most = most.cwiseMax(plant.model.rotor_inertia);
  }
  EXPECT_TRUE(least.isApprox(Eigen::Vector2d(0.8, 0.05))) << least;
  EXPECT_TRUE(most.isApprox(Eigen::Vector2d(1.2, 0.15))) << most;
  EXPECT_THROW((void)uncertain_plants(nominal, parse_uncertainty("rotors=1/2/3")), base::Failure);
}

/// The least modulus over the set is what the design promises: with the plant's links 20 % heavier
/// or lighter the gains keep the share of the margin that is asked beside the motion.
TEST(Uncertainty, GainsKeepTheMarginForTheWholeSet) {
  const std::string text = file_text("two_link.urdf");
  const robot::Model model = robot::model_from_urdf(text, "two_link.urdf");
  const scenario::Scenario scenario = scenario::parse_scenario(
      scenario::urdf_scenario(model, {"bare", "robot.urdf"}), text, "bare");
  DesignGoal goal;
  const Design nominal = design(scenario, goal);
  goal.uncertainty = parse_uncertainty("links=20%,delay=1");
  const Design robust = design(scenario, goal);
  ASSERT_TRUE(robust.uncertain_modulus);
  EXPECT_FALSE(nominal.uncertain_modulus);
  // Found moduli are printed with two digits.
  EXPECT_GE(*robust.uncertain_modulus, range_share * goal.modulus - 0.005);
  EXPECT_GT(robust.loop.modes.settling_s, nominal.loop.modes.settling_s);
  EXPECT_GT(robust.modulus_in_range, nominal.modulus_in_range);
}

}  // namespace
}  // namespace tachless::design
