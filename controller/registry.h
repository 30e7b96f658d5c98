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
#include "scenario/scenario.h"

/// The laws by name: what each declares, and from a scenario to a law. Includes no law; the list is
/// controller/laws.h.
namespace tachless::controller {

/// A parameter that a law declares.
struct Parameter {
  std::string_view name, unit, meaning;
  base::Shape shape = base::Shape::joints;
  base::Range range;
  std::string allowed;  ///< what may be written for it, in words
  bool required = true;
  std::string_view described_default{};  ///< what stands in for it, where the law decides
};

/// Declarations of a law, found by its name.
struct LawFacts {
  std::string_view name;
  std::string_view measurement{};               ///< suffix of the channel that it is fed from
  std::span<const messages::Signal> signals{};  ///< rows of its `messages::LawSignals`
  std::vector<Parameter> parameters{};
  std::string_view source{}, proved{}, conditions{};
  std::string_view lyapunov_formula{};  ///< empty when it declares no Lyapunov function
  std::string_view no_linearisation{};  ///< why the law cannot be linearised; empty when it can
  bool needs_flexible_joints = false;
  bool regulation_only = false;  ///< its reference must be constant
  bool has_feedforward_lead = false;
  bool reads_links = false;  ///< needs encoders on the links' side of a flexible robot
  /// Its rule of thumb: parameters by name, as a scenario has them. Empty when it declares none.
  std::function<std::map<std::string, Vector>(const law::Tuning&)> tuned{};
};

template <class L>
std::map<std::string, Vector> tuned_by_name(const law::Tuning& tuning) {
  using Gains = typename L::Gains;
  const Gains gains = L::tuned(tuning);
  std::map<std::string, Vector> all;
  base::for_each_key<Gains>([&]<class Member>(const base::Key<Gains, Member>& key) {
    if constexpr (std::is_same_v<Member, Vector>) {
      all[std::string(key.name)] = gains.*key.member;
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
  if constexpr (law::HasLyapunovFunction<L>) facts.lyapunov_formula = L::lyapunov_formula;
  if constexpr (!law::MadeOfVectors<typename L::Memory>) {
    facts.no_linearisation = L::Memory::no_linearisation;
  }
  if constexpr (law::Tuned<L>) facts.tuned = tuned_by_name<L>;
  return facts;
}

/// In the order of `Laws`; without the one of another program (`controller::external_law_name`).
const std::vector<LawFacts>& laws();

std::vector<std::string_view> law_names();

/// Returns the facts of a law; `external` is accepted too.
/// @throw base::Failure(bad_usage) naming the law, the nearest one and all there are.
const LawFacts& law_facts(std::string_view name);

/// Returns the facts of the law that the scenario names.
/// @throw base::Failure(bad_usage) with the key's place
const LawFacts& law_facts(const scenario::Scenario& scenario);

/// The names of the law's parameters, in its order.
std::vector<std::string_view> parameter_names(const LawFacts& law);

/// The model that laws for rigid joints get: URDF and gravity of the scenario, rotor inertia
/// added (M = M_l + J); on a flexible robot too, which they take for rigid. The payload is not in
/// it. @throw base::Failure(bad_usage) when the URDF is not a robot.
robot::Model rigid_model(const scenario::Scenario& scenario);

/// The model that laws for flexible joints get: M_l without rotors, K and J.
/// @throw base::Failure(bad_usage) when the URDF is not a robot or its joints are rigid.
law::FlexibleRobot flexible_robot(const scenario::Scenario& scenario);

/// Sampling, filter, lead and encoders of the scenario.
/// @throw base::Failure(bad_usage) as `scenario::encoder_count`.
law::Settings law_settings(const scenario::Scenario& scenario);

/// Refuses what the law cannot work with: joints, encoders, reference, feed-forward lead,
/// parameters that it does not have.
/// @throw base::Failure(bad_usage).
void require_compatible(const scenario::Scenario& scenario, const LawFacts& law);

/// The scenario's value of a parameter, an entry per joint (all the same unless it is per joint),
/// or of a matrix its diagonal or its rows; nothing when it is not given and not required.
/// @throw base::Failure(bad_usage) when it is missing, of the wrong length, out of its
/// range, or no whole number where it is a count.
std::optional<Vector> given_parameter(const scenario::Scenario& scenario, const LawFacts& law,
                                      const Parameter& parameter);

/// The law's parameters from the scenario; what is not given has the declared default.
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

/// The law L with the scenario's robot, parameters and settings.
/// @throw base::Failure(bad_usage), one line with file, line, key, value and allowed range,
/// as the two functions above.
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

/// The scenario with the gains of a message (scenario::gains_text) in place of those of the same
/// name. @throw base::Failure(bad_usage) when that text is none
scenario::Scenario with_gains(scenario::Scenario scenario, std::string_view gains);

/// @throw base::Failure(bad_usage) when a count among the law's parameters differs
void require_same_counts(const scenario::Scenario& before, const scenario::Scenario& after,
                         const LawFacts& law);

/// The law L over the scenario's run. @throw base::Failure(bad_usage) as `make_law`.
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
  return std::make_unique<LawWithMemory<L>>(
      make_law<L>(scenario, law), scenario.loop, scenario.controller.friction,
      law_settings(scenario).feedforward_lead_s, std::move(retuned));
}

/// Returns the announcement of the law by its controller.
messages::LawInfo law_info(const AnyLaw& law);

/// The layout of the messages of a run under this law.
messages::Layout law_layout(const scenario::Scenario& scenario, const AnyLaw& law);

/// From a scenario to its law.
using MakeLaw = std::function<ScenarioLaw(const scenario::Scenario&)>;

/// The law that the scenario names.
/// @throw base::Failure(bad_usage) as `make_law`, or when there is no such law
/// or it is in another program.
ScenarioLaw scenario_law(const scenario::Scenario& scenario);

}  // namespace tachless::controller
