#pragma once

#include "scenario/reader.h"

namespace tachless::scenario {

/// Returns the map `plant.driver`, or a null node if the scenario has none. The scenario holds the
/// map as text, because only a driver knows its keys.
YamlNode driver_node(const Scenario& scenario);

/// Reads `plant.driver` into a driver's own struct with keys (core/base/schema.h).
/// @throw Failure(bad_usage) for a wrong key or value. Its line names the place, the value and the
/// allowed values.
template <class Settings>
Settings driver_settings(const Scenario& scenario) {
  const YamlNode node = driver_node(scenario);
  Settings settings;
  read(Place{scenario, node.kind == YamlNode::Kind::null ? nullptr : &node, "plant.driver"},
       settings);
  return settings;
}

}  // namespace tachless::scenario
