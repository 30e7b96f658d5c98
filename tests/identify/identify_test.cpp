// Identification of emulated arms whose parameters the law and the recorded scenario do not know.

#include "identify/identify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <variant>
#include <vector>

#include "controller/registry.h"
#include "identify/least_squares.h"
#include "study/in_process_loop.h"

namespace tachless::identify {
namespace {

const std::vector<Kind> all = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::payload};

void ignore(std::string_view /*what*/) {}

experiment::Scenario two_link(const std::string& bits, const std::string& seconds) {
  return experiment::load_scenario(
      TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
      {"plant.mechanics=native", "plant.encoder.resolution_bits=" + bits,
       "loop.duration_s=" + seconds, "plant.integrator.accuracy=1e-8",
       "reference={multi_sine: {terms: [{amplitude_rad: [0.5, 0.6], frequency_hz: [0.31, 0.43]}, "
       "{amplitude_rad: 0.3, frequency_hz: [0.83, 1.1]}, "
       "{amplitude_rad: 0.1, frequency_hz: [2.1, 2.7]}]}}"});
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

TEST(Identify, IntervalsHoldTheTruthOfHiddenArms) {
  std::mt19937 random(3);
  const auto between = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  int held = 0, of = 0;
  std::vector<std::vector<double>> errors(kind_names.size());
  for (int arm = 0; arm < 6; ++arm) {
    const experiment::Scenario believed = two_link(arm % 2 == 0 ? "20" : "16", "10");
    Eigen::VectorXd truth(7);
    truth << between(0.2, 2), between(0.05, 0.5), between(1, 10), between(0.2, 2), between(1, 10),
        between(0.3, 3), between(0.2, 2);
    const Recording recording = record(believed, hidden(believed, truth));
    const Identified found = identify({recording}, all, {}, ignore);
    ASSERT_EQ(found.parameters.size(), 7U);
    for (std::size_t i = 0; i < 7; ++i) {
      const Identified::Parameter& each = found.parameters[i];
      const double error = each.value - truth[static_cast<Eigen::Index>(i)];
      EXPECT_EQ(each.doubt, "") << each.entry.name;
      held += std::abs(error) <= each.half_width ? 1 : 0;
      ++of;
      errors[static_cast<std::size_t>(each.entry.kind)].push_back(
          std::abs(error) / truth[static_cast<Eigen::Index>(i)]);
    }
    if (testing::Test::HasFailure()) std::cout << text(found, "arm");
    if (arm == 0) std::cout << text(found, "arm") << truth.transpose() << "\n";
  }
  for (std::size_t kind = 0; kind < errors.size(); ++kind) {
    std::ranges::sort(errors[kind]);
    std::cout << kind_names[kind] << ": median error "
              << 100 * errors[kind][errors[kind].size() / 2] << " %, largest "
              << 100 * errors[kind].back() << " %\n";
  }
  std::cout << held << " of " << of << " intervals hold the truth\n";
  EXPECT_GE(held, of * 85 / 100);
}

}  // namespace
}  // namespace tachless::identify
