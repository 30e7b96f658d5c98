#pragma once

#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "controller/any_law.h"
#include "controller/law/flexible_robot.h"
#include "controller/law/settings.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"
#include "robot/model.h"

/// The laws by name: what each declares, and from a scenario to a law. Includes no law; the list is
/// controller/laws.h.
namespace tachless::controller {

/// What is known of a law by its name alone; all of it follows from what the law declares.
struct LawFacts {
  std::string_view name;
  std::string_view measurement;           ///< suffix of the channel that it is fed from
  std::span<const loop::Signal> signals;  ///< rows of its `loop::LawSignals`
  std::vector<std::string_view> gains;
  bool needs_flexible_joints = false;
  bool regulation_only = false;  ///< its reference must be constant
  bool has_feedforward_lead = false;
  bool reads_links = false;   ///< needs encoders on the links' side of a flexible robot
  bool reads_motors = false;  ///< needs encoders on the motors' side of a flexible robot
};

/// In the order of `Laws`.
const std::vector<LawFacts>& laws();

std::vector<std::string_view> law_names();

/// @throw std::invalid_argument naming the law, the nearest one and all there are.
const LawFacts& law_facts(std::string_view name);

/// Suffix of the channel that feeds the law.
/// @throw std::invalid_argument as `law_facts`.
std::string_view measurement_suffix(std::string_view name);

/// The model that laws for rigid joints get: URDF and gravity of the scenario, rotor inertia
/// added (M = M_l + J); on a flexible robot too, which they take for rigid. The payload is not in
/// it. @throw diagnostics::Failure(bad_usage) when the URDF is not a robot.
robot::Model rigid_model(const experiment::Scenario& scenario);

/// The model that laws for flexible joints get: M_l without rotors, K and J.
/// @throw diagnostics::Failure(bad_usage) when the URDF is not a robot or its joints are rigid.
law::FlexibleRobot flexible_robot(const experiment::Scenario& scenario);

/// Sampling, filter and lead of the scenario.
law::Settings law_settings(const experiment::Scenario& scenario);

/// Refuses what the law cannot work with: joints, encoders, reference, feed-forward lead, gains
/// that no law has. @throw diagnostics::Failure(bad_usage).
void require_compatible(const experiment::Scenario& scenario, const LawFacts& law);

/// The gain of that name. @throw diagnostics::Failure(bad_usage) when it is missing, of the wrong
/// length or not positive in every entry.
robot::Vector required_gain(const experiment::Scenario& scenario, const LawFacts& law,
                            std::string_view gain);

/// The law L with the scenario's robot, gains and settings. Gains that only other laws have are
/// left alone, so that one scenario can be run under several laws.
/// @throw diagnostics::Failure(bad_usage), one line with file, line, key, value and allowed range,
/// as the two functions above.
template <class L>
L make_law(const experiment::Scenario& scenario) {
  const LawFacts& law = law_facts(L::name);
  require_compatible(scenario, law);
  typename L::Gains gains;
  for (const auto& gain : L::Gains::names) {
    gains.*gain.value = required_gain(scenario, law, gain.name);
  }
  try {
    if constexpr (std::is_same_v<typename L::Robot, law::FlexibleRobot>) {
      return L(flexible_robot(scenario), std::move(gains), law_settings(scenario));
    } else {
      return L(rigid_model(scenario), std::move(gains), law_settings(scenario));
    }
  } catch (const std::invalid_argument& problem) {
    throw scenario.complaint("controller.gains", problem.what());
  }
}

/// A law by the measurement that it is fed.
template <class Measurement>
using AnyLawOf = std::unique_ptr<AnyLaw<Measurement>>;
using ScenarioLaw = loop::EachMeasurement<AnyLawOf>;

/// The law that the scenario names. Visit it with a function of `std::unique_ptr<AnyLaw<M>>`: it is
/// compiled once per measurement type.
/// @throw diagnostics::Failure(bad_usage) as `make_law`, or when there is no such law.
ScenarioLaw scenario_law(const experiment::Scenario& scenario);

}  // namespace tachless::controller
