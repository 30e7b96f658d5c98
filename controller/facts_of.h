#pragma once

#include <map>
#include <string>
#include <type_traits>

#include "controller/law/lyapunov.h"
#include "controller/registry.h"

/// What follows from a law's declarations. For the registry, and for laws that are not in it.
namespace tachless::controller {

template <class L>
std::map<std::string, robot::Vector> tuned_by_name(const law::Tuning& tuning) {
  using Gains = typename L::Gains;
  const Gains gains = L::tuned(tuning);
  std::map<std::string, robot::Vector> all;
  schema::for_each_key<Gains>([&]<class Member>(const schema::Key<Gains, Member>& key) {
    if constexpr (std::is_same_v<Member, robot::Vector>) {
      all[std::string(key.name)] = gains.*key.member;
    } else {
      all[std::string(key.name)] = tuning.each(static_cast<double>(gains.*key.member));
    }
  });
  return all;
}

template <class L>
LawFacts facts_of() {
  LawFacts facts;
  facts.name = L::name;
  facts.measurement = loop::MessageOf<typename L::Measurement>::suffix;
  facts.signals = L::signals;
  schema::for_each_key<typename L::Gains>([&]<class Member>(
                                              const schema::Key<typename L::Gains, Member>& key) {
    facts.parameters.push_back({key.name, key.unit, key.meaning, schema::shape_of<Member>,
                                key.range, schema::allowed_text(key),
                                key.fallback == schema::Default::required, key.described_default});
  });
  facts.source = L::source;
  facts.proved = L::proved;
  facts.conditions = L::conditions;
  if constexpr (law::HasLyapunovFunction<L>) facts.lyapunov_formula = L::lyapunov_formula;
  if constexpr (!law::MadeOfVectors<typename L::Memory>) {
    facts.no_linearisation = L::Memory::no_linearisation;
  }
  facts.needs_flexible_joints = std::is_same_v<typename L::Robot, law::FlexibleRobot>;
  facts.regulation_only = L::regulation_only;
  facts.has_feedforward_lead = L::has_feedforward_lead;
  facts.reads_links = loop::holds_links<typename L::Measurement>;
  facts.reads_motors = loop::holds_motors<typename L::Measurement>;
  if constexpr (law::Tuned<L>) facts.tuned = tuned_by_name<L>;
  return facts;
}

}  // namespace tachless::controller
