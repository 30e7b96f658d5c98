#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "controller/registry.h"
#include "identify/identify.h"
#include "in_process/in_process_loop.h"

/// Emulated arms whose parameters neither the law nor the recorded scenario knows.
namespace tachless::identify {

inline const std::vector<Kind> all = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::payload};

inline void ignore(std::string_view /*what*/) {}

/// Returns the parameter of this name; nullptr: there is none.
inline const Identified::Parameter* parameter(const Identified& found, const std::string& name) {
  const auto at = std::ranges::find_if(found.parameters,
                                       [&](const auto& each) { return each.entry.name == name; });
  return at == found.parameters.end() ? nullptr : &*at;
}

/// Returns a multi-sine about the initial posture with separate frequencies for the joints.
inline std::string multi_sine(const std::string& offset, int joints) {
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

inline scenario::Scenario scenario(const std::string& name, const std::string& bits,
                                   double seconds) {
  const std::vector<std::string> common = {"plant.mechanics=native",
                                           "plant.integrator.accuracy=1e-8",
                                           "plant.on_limit=warn",
                                           "plant.drive.torque_limit_Nm=null",
                                           "plant.encoder.resolution_bits=" + bits,
                                           "loop.duration_s=" + std::to_string(seconds)};
  const std::string path = TACHLESS_SOURCE_DIR "/scenarios/" + name + ".yaml";
  const scenario::Scenario base = scenario::load_scenario(path, common);
  const Vector& at = base.plant.initial.position_rad;
  std::string offset;
  for (const double q : at) offset += (offset.empty() ? "[" : ", ") + std::to_string(q);
  std::vector<std::string> all_of_them = common;
  all_of_them.push_back(multi_sine(offset + "]", base.num_joints));
  return scenario::load_scenario(path, all_of_them);
}

/// Returns the recording of a loop whose law knows `believed` while the plant is `plant`.
/// @param driver that replaces the emulator; null: the emulator
inline Recording record(const scenario::Scenario& believed, const scenario::Scenario& plant,
                        plant::RobotDriver* driver = nullptr) {
  Recording result{"a run", believed, Eigen::MatrixXd(believed.loop.num_ticks, believed.num_joints),
                   Eigen::MatrixXd(believed.loop.num_ticks, believed.num_joints)};
  const auto on_tick = [&](const in_process::TickRecord& tick) {
    result.q.row(tick.tick) =
        std::get<messages::PositionMeasurement>(tick.measurement).q.transpose();
    result.tau.row(tick.tick) = tick.applied.tau.transpose();
    return true;
  };
  in_process::run_in_process(plant, controller::scenario_law(believed), on_tick, driver);
  return result;
}

/// Draws parameters of a size that the gains of `believed` can move.
inline Eigen::VectorXd draw_truth(const scenario::Scenario& believed, const Parameters& parameters,
                                  std::mt19937& random) {
  const Vector& kp = believed.controller.gains.at("kp");
  Eigen::VectorXd truth(parameters.size());
  for (Eigen::Index i = 0; i < truth.size(); ++i) {
    const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
    const double share = entry.kind == Kind::rotor ? 0.01 : 0.03;
    truth[i] = std::uniform_real_distribution<double>(0.2, 2)(random) *
               (entry.joint < 0 ? 1 : share * std::sqrt(kp[entry.joint]));
  }
  return truth;
}

/// Returns the plant with hidden parameters and the scenario's own encoders.
inline scenario::Scenario hidden(const scenario::Scenario& believed,
                                 const Eigen::VectorXd& values) {
  scenario::Scenario plant = Parameters(believed, all).plant(believed, values);
  plant.plant.encoder = believed.plant.encoder;
  return plant;
}

}  // namespace tachless::identify
