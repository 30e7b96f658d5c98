// Identification of emulated arms whose parameters the law and the recorded scenario do not know.

#include "identify/identify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "controller/registry.h"
#include "study/in_process_loop.h"

namespace tachless::identify {
namespace {

const std::vector<Kind> all = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::payload};

void ignore(std::string_view /*what*/) {}

/// A multi-sine about the initial posture, joints at frequencies of their own.
std::string multi_sine(const std::string& offset, int joints) {
  std::string terms;
  for (const auto& [amplitude, lowest] : {std::pair{0.4, 0.23}, {0.2, 0.71}, {0.06, 1.9}}) {
    std::string frequency;
    for (int i = 0; i < joints; ++i) {
      frequency += (i > 0 ? ", " : "") + std::to_string(lowest * (1 + 0.13 * i));
    }
    terms +=
        "{amplitude_rad: " + std::to_string(amplitude) + ", frequency_hz: [" + frequency + "]}, ";
  }
  return "reference={multi_sine: {offset_rad: " + offset + ", terms: [" + terms + "]}}";
}

experiment::Scenario scenario(const std::string& name, const std::string& bits, double seconds) {
  const std::vector<std::string> common = {"plant.mechanics=native",
                                           "plant.integrator.accuracy=1e-8",
                                           "plant.on_limit=warn",
                                           "plant.drive.torque_limit_Nm=null",
                                           "plant.encoder.resolution_bits=" + bits,
                                           "loop.duration_s=" + std::to_string(seconds)};
  const std::string path = TACHLESS_SOURCE_DIR "/scenarios/" + name + ".yaml";
  const experiment::Scenario base = experiment::load_scenario(path, common);
  const robot::Vector& at = base.plant.initial.position_rad;
  std::string offset;
  for (const double q : at) offset += (offset.empty() ? "[" : ", ") + std::to_string(q);
  std::vector<std::string> all_of_them = common;
  all_of_them.push_back(multi_sine(offset + "]", base.num_joints));
  return experiment::load_scenario(path, all_of_them);
}

/// What a log of the loop has, whose law believes `believed` while its plant is another.
Recording record(const experiment::Scenario& believed, const experiment::Scenario& plant) {
  Recording result{"a run", believed, Eigen::MatrixXd(believed.loop.num_ticks, believed.num_joints),
                   Eigen::MatrixXd(believed.loop.num_ticks, believed.num_joints)};
  study::run_in_process(plant, controller::scenario_law(believed), [&](const auto& tick) {
    result.q.row(tick.tick) = std::get<loop::PositionMeasurement>(tick.measurement).q.transpose();
    result.tau.row(tick.tick) = tick.applied.tau.transpose();
    return true;
  });
  return result;
}

/// The plant with hidden parameters and the scenario's own encoders.
experiment::Scenario hidden(const experiment::Scenario& believed, const Eigen::VectorXd& values) {
  experiment::Scenario plant = Parameters(believed, all).plant(believed, values);
  plant.plant.encoder = believed.plant.encoder;
  return plant;
}

/// Hidden arms, and how well each kind of parameter was found.
class Tally {
 public:
  /// Rotor inertia and friction are of the size that the gains can move.
  void add(const std::string& name, const std::string& bits, double seconds) {
    const experiment::Scenario believed = scenario(name, bits, seconds);
    const Parameters parameters(believed, all);
    const robot::Vector& kp = believed.controller.gains.at("kp");
    Eigen::VectorXd truth(parameters.size());
    for (Eigen::Index i = 0; i < truth.size(); ++i) {
      const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
      const double share = entry.kind == Kind::rotor ? 0.01 : 0.03;
      truth[i] = std::uniform_real_distribution<double>(0.2, 2)(random_) *
                 (entry.joint < 0 ? 1 : share * std::sqrt(kp[entry.joint]));
    }
    const Recording recording = record(believed, hidden(believed, truth));
    const Identified found = identify({recording}, all, {}, ignore);
    for (std::size_t i = 0; i < found.parameters.size(); ++i) {
      const Identified::Parameter& each = found.parameters[i];
      const double error = std::abs(each.value - truth[static_cast<Eigen::Index>(i)]);
      EXPECT_EQ(each.doubt, "") << each.entry.name;
      held_ += error <= each.half_width ? 1 : 0;
      ++of_;
      errors_[each.entry.kind].push_back(error / truth[static_cast<Eigen::Index>(i)]);
    }
    if (bits == "14") return;  // differences of such counts are no measure of a wrist's torque
    for (const Identified::Check& each : found.checks) EXPECT_LT(each.after, 0.02) << each.joint;
  }

  [[nodiscard]] double held() const { return static_cast<double>(held_) / of_; }
  double median(Kind kind) {
    std::vector<double>& of = errors_[kind];
    std::ranges::nth_element(of, of.begin() + std::ssize(of) / 2);
    return of[of.size() / 2];
  }

 private:
  std::mt19937 random_{3};
  std::map<Kind, std::vector<double>> errors_;
  int held_ = 0, of_ = 0;
};

/// TACHLESS_IDENTIFY_ARMS=N tries N arms.
TEST(Identify, FindsHiddenArmsWithinItsIntervals) {
  const char* many = std::getenv("TACHLESS_IDENTIFY_ARMS");
  Tally tally;
  for (int arm = 0; arm < (many != nullptr ? std::atoi(many) : 6); ++arm) {
    const std::string bits = std::to_string(14 + 2 * (arm % 4));
    if (arm % 3 == 2) {
      tally.add("iiwa_point_to_point", bits, 10);
    } else {
      tally.add("practical_rigid", bits, 10);
    }
  }
  std::cout << "held " << tally.held() << ", medians";
  for (const Kind kind : all) std::cout << " " << tally.median(kind);
  std::cout << "\n";
  // The goals of the medians; 6 arms have 66 intervals, of which 95 % is 63 +- 2.
  EXPECT_GE(tally.held(), 0.88);
  EXPECT_LE(tally.median(Kind::rotor), 0.01);
  EXPECT_LE(tally.median(Kind::viscous), 0.02);
  EXPECT_LE(tally.median(Kind::coulomb), 0.01);
  EXPECT_LE(tally.median(Kind::payload), 0.001);
}

}  // namespace
}  // namespace tachless::identify
