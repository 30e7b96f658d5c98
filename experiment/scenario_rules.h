#pragma once

#include "experiment/scenario.h"

namespace tachless::experiment {

/// The rules between keys of `robot` and `plant`, of a scenario that is read and has its model.
/// @throw Failure(bad_usage), one line: where, key, value, what is allowed.
void require_consistent(const Scenario& scenario);

}  // namespace tachless::experiment
