#include "controller/catalogue.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <stdexcept>

#include "bus/wire.h"

namespace tachless::controller {
namespace {

/// What a measurement holds decides which encoders the robot must have.
template <class Measurement>
constexpr bool holds_links = requires(Measurement m) {
  m.q;
};
template <class Measurement>
constexpr bool holds_motors = requires(Measurement m) {
  m.theta;
};

template <class L>
LawFacts facts_of() {
  LawFacts facts;
  facts.name = L::name;
  facts.measurement = loop::ChannelOf<typename L::Measurement>::suffix;
  facts.num_filters = L::num_filters;
  facts.filter_labels = L::num_filters == 1 ? std::vector<std::string_view>{""}
                                            : std::vector<std::string_view>{"1", "2"};
  for (const auto& gain : L::Gains::names) {
    facts.gains.push_back(gain.name);
  }
  facts.needs_flexible_joints = std::is_same_v<typename L::Robot, law::FlexibleRobot>;
  facts.regulation_only = L::regulation_only;
  facts.has_feedforward_lead = L::has_feedforward_lead;
  facts.reads_links = holds_links<typename L::Measurement>;
  facts.reads_motors = holds_motors<typename L::Measurement>;
  return facts;
}

template <class... L>
std::vector<LawFacts> facts_of_all(LawList<L...> /*laws*/) {
  return {facts_of<L>()...};
}

/// Insertions, deletions and replacements from one to the other (Levenshtein).
std::size_t edit_distance(std::string_view from, std::string_view to) {
  std::vector<std::size_t> row(to.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < from.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < to.size(); ++j) {
      const std::size_t replaced = diagonal + (from[i] == to[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

std::string_view nearest(std::string_view name, const std::vector<std::string_view>& known) {
  return *std::min_element(known.begin(), known.end(), [&](auto x, auto y) {
    return edit_distance(name, x) < edit_distance(name, y);
  });
}

std::string joined(const std::vector<std::string_view>& names) {
  std::string text;
  for (const std::string_view name : names) {
    text += (text.empty() ? "" : ", ") + std::string(name);
  }
  return text;
}

std::string no_such_law(std::string_view name) {
  return "no law \"" + std::string(name) + "\"; did you mean " +
         std::string(nearest(name, law_names())) + "? Allowed: " + joined(law_names());
}

std::string shown(const robot::Vector& value) {
  std::ostringstream text;
  text << '[';
  for (Eigen::Index i = 0; i < value.size(); ++i) {
    text << (i == 0 ? "" : ", ") << value[i];
  }
  text << ']';
  return text.str();
}

std::string gain_key(std::string_view gain) { return "controller.gains." + std::string(gain); }

void require_known_gains(const experiment::Scenario& scenario, const LawFacts& facts) {
  std::vector<std::string_view> known;
  for (const LawFacts& law : laws()) {
    known.insert(known.end(), law.gains.begin(), law.gains.end());
  }
  for (const auto& [gain, value] : scenario.controller.gains) {
    if (std::find(known.begin(), known.end(), gain) == known.end()) {
      throw scenario.complaint(gain_key(gain), "no law has this gain; did you mean " +
                                                   std::string(nearest(gain, facts.gains)) +
                                                   "? Gains of " + std::string(facts.name) + ": " +
                                                   joined(facts.gains));
    }
  }
}

std::string_view name(experiment::EncoderSide side) {
  switch (side) {
    case experiment::EncoderSide::link:
      return "link";
    case experiment::EncoderSide::motor:
      return "motor";
    case experiment::EncoderSide::both:
      return "both";
  }
  throw std::logic_error("catalogue: no such encoder side");
}

void require_encoders(const experiment::Scenario& scenario, const LawFacts& law) {
  if (!scenario.robot.flexible) {
    return;  // a rigid robot has one angle per joint, whatever side it is read on
  }
  const experiment::EncoderSide side = scenario.plant.encoder.side;
  if ((law.reads_links && side == experiment::EncoderSide::motor) ||
      (law.reads_motors && side == experiment::EncoderSide::link)) {
    std::string allowed = "both";
    if (!law.reads_links) {
      allowed += " or motor";
    }
    if (!law.reads_motors) {
      allowed += " or link";
    }
    throw scenario.complaint("plant.encoder.side", std::string(name(side)) + "; allowed with law " +
                                                       std::string(law.name) + ": " + allowed);
  }
}

std::vector<std::string_view> laws_for_rigid_joints() {
  std::vector<std::string_view> names;
  for (const LawFacts& law : laws()) {
    if (!law.needs_flexible_joints) {
      names.push_back(law.name);
    }
  }
  return names;
}

robot::Model urdf_model(const experiment::Scenario& scenario) {
  try {
    robot::Model model = robot::model_from_urdf(scenario.robot.urdf_text, scenario.robot.urdf_path);
    model.gravity = {0, 0, -scenario.robot.gravity_m_per_s2};
    return model;
  } catch (const std::invalid_argument& problem) {
    throw scenario.complaint("robot.urdf", problem.what());
  }
}

law::Discretisation discretisation(experiment::FilterKind kind) {
  switch (kind) {
    case experiment::FilterKind::first_order_hold:
      return law::Discretisation::first_order_hold;
    case experiment::FilterKind::tustin:
      return law::Discretisation::tustin;
    case experiment::FilterKind::backward_euler:
      return law::Discretisation::backward_euler;
    case experiment::FilterKind::zero_order_hold:
      return law::Discretisation::zero_order_hold;
  }
  throw std::logic_error("catalogue: no such filter");
}

}  // namespace

const std::vector<LawFacts>& laws() {
  static const std::vector<LawFacts> all = facts_of_all(Laws{});
  return all;
}

std::vector<std::string_view> law_names() {
  std::vector<std::string_view> names;
  for (const LawFacts& law : laws()) {
    names.push_back(law.name);
  }
  return names;
}

const LawFacts& law_facts(std::string_view name) {
  for (const LawFacts& law : laws()) {
    if (law.name == name) {
      return law;
    }
  }
  throw std::invalid_argument(no_such_law(name));
}

std::string_view measurement_suffix(std::string_view name) { return law_facts(name).measurement; }

int num_filters(std::string_view name) { return law_facts(name).num_filters; }

robot::Model rigid_model(const experiment::Scenario& scenario) {
  robot::Model model = urdf_model(scenario);
  model.rotor_inertia = scenario.robot.flexible ? scenario.robot.flexible->rotor_inertia_kgm2
                                                : scenario.robot.rigid_rotor_inertia_kgm2;
  return model;
}

law::FlexibleRobot flexible_robot(const experiment::Scenario& scenario) {
  if (!scenario.robot.flexible) {
    throw scenario.complaint("robot.joints", "rigid; needed: flexible");
  }
  return {urdf_model(scenario), scenario.robot.flexible->stiffness_Nm_per_rad,
          scenario.robot.flexible->rotor_inertia_kgm2};
}

law::Settings law_settings(const experiment::Scenario& scenario, int ticks) {
  law::Settings settings;
  settings.period_s = ticks * scenario.loop.period_s;
  settings.filter = discretisation(scenario.controller.filter);
  settings.filter_start = scenario.controller.filter_start == experiment::FilterStart::zero
                              ? law::FilterStart::zero
                              : law::FilterStart::at_error;
  if (scenario.controller.feedforward_lead == experiment::FeedforwardLead::half_tick_plus_delay) {
    settings.feedforward_lead_s = (0.5 + scenario.loop.command_delay) * scenario.loop.period_s;
  }
  return settings;
}

diagnostics::Failure unknown_law(const experiment::Scenario& scenario) {
  return scenario.complaint("controller.law", no_such_law(scenario.controller.law));
}

void require_compatible(const experiment::Scenario& scenario, const LawFacts& law) {
  const std::string law_name(law.name);
  if (law.needs_flexible_joints && !scenario.robot.flexible) {
    throw scenario.complaint("controller.law",
                             law_name +
                                 " needs robot.joints: {flexible: …}, and the joints are rigid; "
                                 "allowed on rigid joints: " +
                                 joined(laws_for_rigid_joints()));
  }
  if (law.regulation_only && !std::holds_alternative<experiment::Hold>(scenario.reference)) {
    throw scenario.complaint(
        "controller.law",
        law_name + " regulates, and the reference moves; allowed reference: hold");
  }
  if (!law.has_feedforward_lead &&
      scenario.controller.feedforward_lead != experiment::FeedforwardLead::none) {
    throw scenario.complaint(
        "controller.feedforward_lead",
        "half_tick_plus_delay, but " + law_name +
            " differentiates its feed-forward twice and would need derivatives "
            "beyond snap; allowed: none");
  }
  require_encoders(scenario, law);
  require_known_gains(scenario, law);
}

robot::Vector required_gain(const experiment::Scenario& scenario, const LawFacts& law,
                            std::string_view gain) {
  const auto found = scenario.controller.gains.find(std::string(gain));
  if (found == scenario.controller.gains.end()) {
    throw scenario.complaint("controller.gains", std::string(gain) + " is missing; gains of " +
                                                     std::string(law.name) + ": " +
                                                     joined(law.gains));
  }
  const robot::Vector& value = found->second;
  if (value.size() != scenario.num_joints) {
    throw scenario.complaint(gain_key(gain), shown(value) + " has " + std::to_string(value.size()) +
                                                 " entries; needed: one per joint, " +
                                                 std::to_string(scenario.num_joints));
  }
  for (const double entry : value) {
    if (!(entry > 0 && std::isfinite(entry))) {
      throw scenario.complaint(gain_key(gain),
                               shown(value) + "; allowed: every entry greater than 0");
    }
  }
  return value;
}

}  // namespace tachless::controller
