#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/schema.h"
#include "controller/any_law.h"
#include "controller/law/parts.h"
#include "messages/measurements.h"
#include "robot/model.h"
#include "scenario/gains.h"
#include "scenario/scenario.h"

/// The laws by name, their declarations, and the law of a scenario. This header includes no law;
/// the list of laws is controller/laws.h.
namespace tachless::controller {

/// A parameter that a law declares.
struct Parameter {
  std::string_view name, unit, meaning;
  base::Shape shape = base::Shape::joints;
  base::Range range;
  std::string allowed;  ///< allowed values, in words
  bool required = true;
  std::string_view described_default{};  ///< default in words, if the law decides it
};

/// Declarations of a law, found by its name.
struct LawFacts {
  std::string_view name;
  std::string_view measurement{};               ///< suffix of the channel with its measurements
  std::span<const messages::Signal> signals{};  ///< rows of its `messages::LawSignals`
  std::vector<Parameter> parameters{};
  std::string_view source{}, proved{}, conditions{};
  std::string_view lyapunov_formula{};  ///< empty if the law declares no Lyapunov function
  std::string_view no_linearisation{};  ///< reason against linearisation; else empty
  bool needs_flexible_joints = false;
  bool regulation_only = false;  ///< the reference must be constant
  bool has_feedforward_lead = false;
  bool needs_torque_limit = false;  ///< each drive must have a torque limit
  bool reads_links = false;         ///< needs encoders on the links' side of a flexible robot
  /// Rule of thumb: parameters by name, in the form of a scenario. Empty if the law declares none.
  std::function<std::map<std::string, Vector>(const law::Tuning&)> tuned{};
};

template <class L>
std::map<std::string, Vector> tuned_by_name(const law::Tuning& tuning) {
  using Gains = typename L::Gains;
  const Gains gains = L::tuned(tuning);
  std::map<std::string, Vector> all;
  base::for_each_key<Gains>([&]<class Member>(const base::Key<Gains, Member>& key) {
    if constexpr (std::is_same_v<Member, Vector>) {
      // A parameter that the rule leaves to its default is absent.
      if ((gains.*key.member).size() > 0) all[std::string(key.name)] = gains.*key.member;
    } else if constexpr (std::is_same_v<Member, Matrix>) {
      all[std::string(key.name)] = (gains.*key.member).diagonal();
    } else {
      all[std::string(key.name)] = tuning.each(static_cast<double>(gains.*key.member));
    }
  });
  return all;
}

/// Returns the facts that a law declares; it need not be in the registry.
template <class L>
LawFacts facts_of() {
  using Gains = typename L::Gains;
  using Measurement = typename L::Measurement;
  LawFacts facts{.name = L::name,
                 .measurement = Measurement::suffix,
                 .signals = L::signals,
                 .source = L::source,
                 .proved = L::proved,
                 .conditions = L::conditions,
                 .needs_flexible_joints = std::is_same_v<typename L::Robot, law::FlexibleRobot>,
                 .regulation_only = L::regulation_only,
                 .has_feedforward_lead = L::has_feedforward_lead,
                 .reads_links = messages::holds_links<Measurement>};
  base::for_each_key<Gains>([&]<class Member>(const base::Key<Gains, Member>& key) {
    facts.parameters.push_back({key.name, key.unit, key.meaning, base::shape_of<Member>, key.range,
                                base::allowed_text(key), key.fallback == base::Default::required,
                                key.described_default});
  });
  facts.needs_torque_limit = requires { L::needs_torque_limit; };
  if constexpr (law::HasLyapunovFunction<L>) facts.lyapunov_formula = L::lyapunov_formula;
  if constexpr (!law::MadeOfVectors<typename L::Memory>) {
    facts.no_linearisation = L::Memory::no_linearisation;
  }
  if constexpr (law::Tuned<L>) facts.tuned = tuned_by_name<L>;
  return facts;
}

/// Returns the laws in the order of `Laws`, without the external law
/// (`controller::external_law_name`).
const std::vector<LawFacts>& laws();

std::vector<std::string_view> law_names();

/// Returns the facts of a law; `external` is accepted too.
/// @throw base::Failure(bad_usage) naming the law, the nearest name and all names.
const LawFacts& law_facts(std::string_view name);

/// Returns the facts of the law that the scenario names.
/// @throw base::Failure(bad_usage) with the key's place
const LawFacts& law_facts(const scenario::Scenario& scenario);

/// Returns the names of the law's parameters in their declared order.
std::vector<std::string_view> parameter_names(const LawFacts& law);

/// Returns those of the gains that the law has.
scenario::Gains gains_of_law(scenario::Gains gains, const LawFacts& law);

/// Returns the model for laws of rigid joints: the scenario's URDF and gravity, with rotor inertia
/// added (M = M_l + J). Laws of rigid joints treat a flexible robot as rigid. The payload is not in
/// the model.
/// @throw base::Failure(bad_usage) if the URDF is not a robot.
robot::Model rigid_model(const scenario::Scenario& scenario);

/// Returns the model for laws of flexible joints: M_l without rotors, K and J.
/// @throw base::Failure(bad_usage) if the URDF is not a robot or its joints are rigid.
law::FlexibleRobot flexible_robot(const scenario::Scenario& scenario);

/// Returns sampling, filter, lead and encoder noise of the scenario.
/// @throw base::Failure(bad_usage) as `scenario::encoder_count`.
law::Settings law_settings(const scenario::Scenario& scenario);

/// Returns whether each drive has a torque limit.
bool has_torque_limits(const scenario::Scenario& scenario);

/// Checks that the law fits the scenario's joints, encoders, reference, feed-forward lead and
/// parameters.
/// @throw base::Failure(bad_usage) for the first misfit.
void require_compatible(const scenario::Scenario& scenario, const LawFacts& law);

/// Returns the scenario's value of a parameter with one entry per joint. The entries are equal
/// unless the parameter is per joint. A matrix is returned as its diagonal or its rows. A parameter
/// that is neither given nor required is nullopt.
/// @throw base::Failure(bad_usage) if the value is missing, has the wrong length, is out of range,
/// or is no whole number for a count.
std::optional<Vector> given_parameter(const scenario::Scenario& scenario, const LawFacts& law,
                                      const Parameter& parameter);

/// Returns the law's parameters from the scenario, with declared defaults for missing ones.
/// @throw base::Failure(bad_usage) as `given_parameter`.
template <class Gains>
Gains gains_of(const scenario::Scenario& scenario, const LawFacts& law) {
  Gains gains;
  auto parameter = law.parameters.begin();
  base::for_each_key<Gains>([&]<class Member>(const base::Key<Gains, Member>& key) {
    const auto given = given_parameter(scenario, law, *parameter++);
    if constexpr (std::is_same_v<Member, Vector>) {
      if (given) {
        gains.*key.member = *given;
      } else if (key.fallback == base::Default::of_joints) {
        gains.*key.member = Vector::Constant(scenario.num_joints, key.each_joint);
      }
    } else if constexpr (std::is_same_v<Member, Matrix>) {
      const int n = scenario.num_joints;
      if (given && given->size() == n) gains.*key.member = given->asDiagonal();
      if (given && given->size() == n * n) gains.*key.member = given->reshaped(n, n);
    } else {
      static_assert(std::is_arithmetic_v<Member>, "a parameter is per joint, a number or a count");
      if (given) gains.*key.member = static_cast<Member>((*given)[0]);
    }
  });
  return gains;
}

/// Returns the law L with the scenario's robot, parameters and settings.
/// @throw base::Failure(bad_usage) as `require_compatible` and `gains_of`: one line with file,
/// line, key, value and allowed range.
template <class L>
L make_law(const scenario::Scenario& scenario, const LawFacts& law = law_facts(L::name)) {
  require_compatible(scenario, law);
  auto gains = gains_of<typename L::Gains>(scenario, law);
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

using ScenarioLaw = std::unique_ptr<AnyLaw>;

/// Returns the scenario with the gains of a message (scenario::gains_text) instead of its gains of
/// the same names.
/// @throw base::Failure(bad_usage) if the text has another form
scenario::Scenario with_gains(scenario::Scenario scenario, std::string_view gains);

/// Checks that the law's parameters that are counts are the same in both scenarios.
/// @throw base::Failure(bad_usage) if a count differs
void require_same_counts(const scenario::Scenario& before, const scenario::Scenario& after,
                         const LawFacts& law);

/// Returns the law L for the scenario's run.
/// @throw base::Failure(bad_usage) as `make_law`.
template <class L>
ScenarioLaw law_over_run(const scenario::Scenario& scenario, const LawFacts& law) {
  typename LawWithMemory<L>::Retuned retuned;
  if (scenario.controller.gains_may_change) {
    retuned = [scenario, law](std::string_view gains) {
      const scenario::Scenario changed = with_gains(scenario, gains);
      require_same_counts(scenario, changed, law);
      return make_law<L>(changed, law);
    };
  }
  typename LawWithMemory<L>::Friction friction;
  constexpr bool feeds_friction = requires { L::feeds_friction; };  // by the law itself
  if (scenario.controller.friction.given() && !feeds_friction) {
    friction = [spec = scenario.controller.friction, robot = rigid_model(scenario),
                lead_s = law_settings(scenario).feedforward_lead_s](const auto& reference) {
      return law::friction_feedforward(spec, robot, reference, lead_s);
    };
  }
  return std::make_unique<LawWithMemory<L>>(make_law<L>(scenario, law), scenario.loop,
                                            std::move(friction), std::move(retuned));
}

/// Returns the data with which a controller announces the law.
messages::LawInfo law_info(const AnyLaw& law);

/// Returns the layout of the messages of a run under this law.
messages::Layout law_layout(const scenario::Scenario& scenario, const AnyLaw& law);

/// Function that returns the law of a scenario.
using MakeLaw = std::function<ScenarioLaw(const scenario::Scenario&)>;

/// Returns the law that the scenario names.
/// @throw base::Failure(bad_usage) as `make_law`, or if the law does not exist or is external.
ScenarioLaw scenario_law(const scenario::Scenario& scenario);

}  // namespace tachless::controller
