#pragma once

#include <string>
#include <vector>

#include "experiment/scenario.h"

namespace tachless::certificate::testing {

/// A scenario that the project ships.
inline experiment::Scenario shipped(const std::string& name,
                                    const std::vector<std::string>& overrides = {}) {
  return experiment::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/" + name + ".yaml", overrides);
}

}  // namespace tachless::certificate::testing
