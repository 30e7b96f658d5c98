#include "plant/encoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "base/elementary.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using ::testing::HasSubstr;

scenario::Scenario scenario(bool flexible = false) {
  scenario::Scenario s;
  s.source = "test.yaml";
  s.controller.law = "a_law";
  if (flexible) s.robot.flexible = FlexibleDrive{};
  return s;
}

/// A revolute joint and a prismatic one that travels from -0.5 to 1.5 m.
robot::Model revolute_and_prismatic() {
  robot::Model model;
  model.num_joints = 2;
  model.joint_names = {"turn", "slide"};
  model.joint_types = {robot::JointType::revolute, robot::JointType::prismatic};
  model.lower = Eigen::Vector2d(-robot::Model::unlimited, -0.5);
  model.upper = Eigen::Vector2d(robot::Model::unlimited, 1.5);
  return model;
}

ArmState state(double first, double second) {
  ArmState s;
  s.q = Eigen::Vector2d(first, second);
  s.v = Eigen::Vector2d(0.1, 0.2);
  s.theta = s.q + Eigen::Vector2d(0.01, 0.02);
  s.thetadot = Eigen::Vector2d(0.3, 0.4);
  return s;
}

Encoder encoder_of(const scenario::Scenario& scenario, const robot::Model& model) {
  return {scenario.plant.encoder, scenario::encoder_count(scenario, model), model};
}

TEST(Encoder, IsExactByDefault) {
  const Encoder encoder = encoder_of(scenario(true), revolute_and_prismatic());
  const ArmState s = state(1.234567890123, -0.2);
  EXPECT_EQ(encoder.measure<messages::PositionMeasurement>(s, 5).q, s.q);
  EXPECT_EQ(encoder.measure<messages::MotorPositionMeasurement>(s, 5).theta, s.theta);
  const auto both = encoder.measure<messages::BothPositionsMeasurement>(s, 5);
  EXPECT_EQ(both.q, s.q);
  EXPECT_EQ(both.theta, s.theta);
  const auto link = encoder.measure<messages::LinkStateMeasurement>(s, 5);
  EXPECT_EQ(link.q, s.q);
  EXPECT_EQ(link.v, s.v);
  EXPECT_EQ(link.theta, s.theta);
  const auto all = encoder.measure<messages::StateMeasurement>(s, 5);
  EXPECT_EQ(all.q, s.q);
  EXPECT_EQ(all.v, s.v);
  EXPECT_EQ(all.theta, s.theta);
  EXPECT_EQ(all.thetadot, s.thetadot);
}

TEST(Encoder, RoundsToTheNearestCountOfARevolutionOrOfTheRange) {
  scenario::Scenario s = scenario();
  s.plant.encoder.resolution_bits = Eigen::Vector2d(10, 4);
  const Encoder encoder = encoder_of(s, revolute_and_prismatic());
  const double turn = 2 * std::numbers::pi / 1024, slide = 2.0 / 16;
  EXPECT_EQ(scenario::encoder_count(s, revolute_and_prismatic())[0], turn);
  EXPECT_EQ(scenario::encoder_count(s, revolute_and_prismatic())[1], slide);
  const auto measured = [&](double first, double second) {
    return encoder.measure<messages::PositionMeasurement>(state(first, second), 0).q;
  };
  EXPECT_EQ(measured(7.4 * turn, -3.6 * slide), Vector(Eigen::Vector2d(7 * turn, -4 * slide)));
  EXPECT_EQ(measured(-7.6 * turn, 3.4 * slide), Vector(Eigen::Vector2d(-8 * turn, 3 * slide)));
}

TEST(Encoder, OfALinkThatTurnsIsEccentric) {
  scenario::Scenario s = scenario(true);
  s.plant.encoder.eccentricity_rad = Vector::Constant(2, 1e-3);
  s.plant.encoder.eccentricity_phase_rad = Eigen::Vector2d(0.4, 0.4);
  const ArmState at = state(0.7, 0.3);
  const auto read =
      encoder_of(s, revolute_and_prismatic()).measure<messages::LinkStateMeasurement>(at, 0);
  EXPECT_EQ(read.q, Vector(at.q + Eigen::Vector2d(1e-3 * std::sin(1.1), 0)));
  EXPECT_EQ(read.theta, at.theta);
}

TEST(Encoder, HasAQuantisationErrorUniformOverACount) {
  scenario::Scenario s = scenario();
  s.plant.encoder.resolution_bits = Vector::Constant(2, 12);
  const Encoder encoder = encoder_of(s, revolute_and_prismatic());
  const double count = scenario::encoder_count(s, revolute_and_prismatic())[0];
  testing::Random random(3);
  double sum_of_squares = 0, largest = 0;
  constexpr int n = 20000;
  for (int k = 0; k < n; ++k) {
    const ArmState exact = state(random(-4, 4), 0);
    const double error = encoder.measure<messages::PositionMeasurement>(exact, k).q[0] - exact.q[0];
    sum_of_squares += error * error;
    largest = std::max(largest, std::abs(error));
  }
  EXPECT_LE(largest, count / 2 * (1 + 1e-9));  // rounding at half a count
  // The variance is count^2 / 12. The bound is five standard deviations of 0.9 / sqrt(n) = 0.6 %.
  EXPECT_NEAR(sum_of_squares / n / (count * count / 12), 1, 0.032);
}

TEST(Encoder, AddsGaussianNoiseOfTheStandardDeviationAsked) {
  scenario::Scenario s = scenario();
  s.plant.encoder.noise_std_rad = 0.01;
  s.plant.encoder.velocity_noise_std_rad_per_s = 0.3;
  const Encoder encoder = encoder_of(s, revolute_and_prismatic());
  const ArmState exact = state(1, 0.5);
  constexpr int n = 40000;
  double mean[4] = {}, square[4] = {}, fourth = 0, product = 0, beside = 0, last = 0;
  for (int k = 0; k < n; ++k) {
    const auto measured = encoder.measure<messages::StateMeasurement>(exact, k);
    const double x[4] = {(measured.q[0] - exact.q[0]) / 0.01, (measured.q[1] - exact.q[1]) / 0.01,
                         (measured.v[0] - exact.v[0]) / 0.3, (measured.v[1] - exact.v[1]) / 0.3};
    for (int i = 0; i < 4; ++i) {
      mean[i] += x[i] / n;
      square[i] += x[i] * x[i] / n;
    }
    fourth += std::pow(x[0], 4) / n;
    product += x[0] * x[1] / n;
    beside += x[0] * last / n;
    last = x[0];
  }
  // The bounds are five standard deviations: 1, sqrt 2 and sqrt 96 over sqrt n.
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(mean[i], 0, 5 / std::sqrt(n));
    EXPECT_NEAR(square[i], 1, 5 * std::sqrt(2.0 / n));
  }
  EXPECT_NEAR(fourth, 3, 5 * std::sqrt(96.0 / n));
  EXPECT_NEAR(product, 0, 5 / std::sqrt(n));
  EXPECT_NEAR(beside, 0, 5 / std::sqrt(n));
}

TEST(Encoder, RepeatsTheNoiseOfARepeatedTick) {
  scenario::Scenario s = scenario();
  s.plant.encoder.noise_std_rad = 0.01;
  const Encoder encoder = encoder_of(s, revolute_and_prismatic());
  const ArmState exact = state(1, 0.5);
  const Vector first = encoder.measure<messages::PositionMeasurement>(exact, 7).q;
  EXPECT_NE(encoder.measure<messages::PositionMeasurement>(exact, 8).q, first);
  EXPECT_EQ(encoder.measure<messages::PositionMeasurement>(exact, 7).q, first);
  s.plant.encoder.seed = 2;
  EXPECT_NE(
      encoder_of(s, revolute_and_prismatic()).measure<messages::PositionMeasurement>(exact, 7).q,
      first);
}

TEST(Encoder, GivesTheSameNoiseToEveryKindOfMeasurement) {
  scenario::Scenario s = scenario(true);
  s.plant.encoder.noise_std_rad = 0.01;
  const Encoder encoder = encoder_of(s, revolute_and_prismatic());
  const ArmState exact = state(1, 0.5);
  const auto all = encoder.measure<messages::StateMeasurement>(exact, 3);
  EXPECT_EQ(encoder.measure<messages::PositionMeasurement>(exact, 3).q, all.q);
  EXPECT_EQ(encoder.measure<messages::MotorPositionMeasurement>(exact, 3).theta, all.theta);
  EXPECT_NE(Vector(all.q - exact.q), Vector(all.theta - exact.theta));
}

// Philox4x32-10 with counter and key 0, from the known answers published with it: the first two
// words make one uniform number, the last two the other.
TEST(StandardNormal, ComesFromTheKnownAnswerOfPhilox) {
  const auto uniform = [](std::uint64_t high, std::uint64_t low) {
    return (static_cast<double>((high << 32 | low) >> 12) + 0.5) * 0x1p-52;
  };
  const double radius = std::sqrt(-2 * base::log(uniform(0x6627e8d5, 0xe169c58d)));
  const double angle = 2 * std::numbers::pi * uniform(0xbc57ac4c, 0x9b00dbd8);
  EXPECT_EQ(standard_normal(0, 0, 0, 0), radius * base::cos(angle));
}

TEST(Encoder, RefusesToCountAPrismaticJointWithoutRange) {
  scenario::Scenario s = scenario();
  s.plant.encoder.resolution_bits = Vector::Constant(2, 10);
  robot::Model model = revolute_and_prismatic();
  model.upper[1] = robot::Model::unlimited;
  try {
    static_cast<void>(encoder_of(s, model));
    FAIL();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("plant.encoder.resolution_bits"));
    EXPECT_THAT(failure.what(), HasSubstr("\"slide\""));
  }
}

/// Returns a digit each for POSITION, MOTOR_POSITION, BOTH_POSITIONS, LINK_STATE and STATE. A 1
/// means that the robot has the encoders.
std::string measurable(bool flexible, EncoderSide side) {
  scenario::Scenario s = scenario(flexible);
  s.plant.encoder.side = side;
  std::string result;
  const auto note = [&](auto measurement) {
    try {
      scenario::require_encoders(s, decltype(measurement)::suffix);
      result += '1';
    } catch (const base::Failure&) {
      result += '0';
    }
  };
  note(messages::PositionMeasurement());
  note(messages::MotorPositionMeasurement());
  note(messages::BothPositionsMeasurement());
  note(messages::LinkStateMeasurement());
  note(messages::StateMeasurement());
  return result;
}

TEST(Encoder, RefusesAMeasurementWhoseSideTheRobotLacks) {
  EXPECT_EQ(measurable(true, EncoderSide::motor), "01000");
  EXPECT_EQ(measurable(true, EncoderSide::link), "10000");
  EXPECT_EQ(measurable(true, EncoderSide::both), "11111");
  for (const auto side : {EncoderSide::link, EncoderSide::motor, EncoderSide::both}) {
    EXPECT_EQ(measurable(false, side), "10001");  // a rigid robot has one position per joint
  }
}

}  // namespace
}  // namespace tachless::plant
