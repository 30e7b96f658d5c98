#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "controller/law/flexible_robot.h"
#include "controller/law/kelly_flexible.h"
#include "controller/law/kelly_regulation.h"
#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_rigid.h"
#include "controller/law/settings.h"
#include "controller/law/slotine_li.h"
#include "controller/law/slotine_li_flexible.h"
#include "controller/law/wen_bayard.h"
#include "experiment/scenario.h"
#include "robot/model.h"

/// From a scenario to a control law.
namespace tachless::controller {

template <class... L>
struct LawList {};

/// Every law there is. To add one: its header above, its name here, its page in docs/laws.
using Laws = LawList<law::LoriaOrtegaRigid, law::LoriaOrtegaFlexible, law::KellyRegulation,
                     law::KellyFlexible, law::WenBayard, law::SlotineLi, law::SlotineLiFlexible>;

/// What is known of a law by its name alone.
struct LawFacts {
  std::string_view name;
  std::string_view measurement;  ///< suffix of the channel that it is fed from
  int num_filters = 0;           ///< rows of its `loop::ControllerState`
  /// One per row, for the names of columns: "" when there is one row, "1" (link), "2" (motor) when
  /// there are two.
  std::vector<std::string_view> filter_labels;
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

/// Suffix of the channel that feeds the law, and the rows of its state.
/// @throw std::invalid_argument as `law_facts`.
std::string_view measurement_suffix(std::string_view name);
int num_filters(std::string_view name);

/// The model that laws for rigid joints get: URDF and gravity of the scenario, rotor inertia
/// added (M = M_l + J); on a flexible robot too, which they take for rigid. The payload is not in
/// it. @throw diagnostics::Failure(bad_usage) when the URDF is not a robot.
robot::Model rigid_model(const experiment::Scenario& scenario);

/// The model that laws for flexible joints get: M_l without rotors, K and J.
/// @throw diagnostics::Failure(bad_usage) when the URDF is not a robot or its joints are rigid.
law::FlexibleRobot flexible_robot(const experiment::Scenario& scenario);

/// Sampling, filter and lead of the scenario, for a law whose steps are `ticks` periods apart. (The
/// lead is that of one period in any case: it makes up for the torque's age, not for the filter's.)
law::Settings law_settings(const experiment::Scenario& scenario, int ticks = 1);

/// Refuses what the law cannot work with: joints, encoders, reference, feed-forward lead, gains
/// that no law has. @throw diagnostics::Failure(bad_usage).
void require_compatible(const experiment::Scenario& scenario, const LawFacts& law);

/// The gain of that name. @throw diagnostics::Failure(bad_usage) when it is missing, of the wrong
/// length or not positive in every entry.
robot::Vector required_gain(const experiment::Scenario& scenario, const LawFacts& law,
                            std::string_view gain);

/// The law L with the scenario's robot, gains and settings. Gains that only other laws have are
/// left alone, so that one scenario can be run under several laws. `ticks`: see `law_settings`.
/// @throw diagnostics::Failure(bad_usage), one line with file, line, key, value and allowed range,
/// as the two functions above.
template <class L>
L make_law(const experiment::Scenario& scenario, int ticks = 1) {
  const LawFacts& law = law_facts(L::name);
  require_compatible(scenario, law);
  typename L::Gains gains;
  for (const auto& gain : L::Gains::names) {
    gains.*gain.value = required_gain(scenario, law, gain.name);
  }
  try {
    if constexpr (std::is_same_v<typename L::Robot, law::FlexibleRobot>) {
      return L(flexible_robot(scenario), std::move(gains), law_settings(scenario, ticks));
    } else {
      return L(rigid_model(scenario), std::move(gains), law_settings(scenario, ticks));
    }
  } catch (const std::invalid_argument& problem) {
    throw scenario.complaint("controller.gains", problem.what());
  }
}

/// @return what to throw when the scenario's law is none of `Laws`: the nearest and the list.
diagnostics::Failure unknown_law(const experiment::Scenario& scenario);

namespace detail {

template <class Visitor, class L, class... Rest>
auto with_law(const experiment::Scenario& scenario, Visitor& visitor, LawList<L, Rest...> /*laws*/)
    -> std::invoke_result_t<Visitor&, const L&> {
  if (scenario.controller.law == L::name) {
    const L chosen = make_law<L>(scenario);
    return visitor(chosen);
  }
  if constexpr (sizeof...(Rest) > 0) {
    return with_law(scenario, visitor, LawList<Rest...>{});
  } else {
    throw unknown_law(scenario);
  }
}

}  // namespace detail

/// Builds the law that the scenario names and hands it to `visitor(const L&)`; returns what that
/// returns. The visitor is compiled once per law.
/// @throw diagnostics::Failure(bad_usage) as `make_law`, or when there is no such law.
template <class Visitor>
auto with_law(const experiment::Scenario& scenario, Visitor&& visitor) {
  return detail::with_law(scenario, visitor, Laws{});
}

}  // namespace tachless::controller
