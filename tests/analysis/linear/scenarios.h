#pragma once

#include <string>
#include <vector>

#include "scenario/scenario.h"

namespace tachless::linear::testing {

/// A scenario that the project ships.
inline scenario::Scenario shipped(const std::string& name,
                                  const std::vector<std::string>& overrides = {}) {
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/" + name + ".yaml", overrides);
}

}  // namespace tachless::linear::testing
